"""Toolbar: a column of buttons in the upper right corner of the window, one for each tool."""

from msph.stage.sheet import LINE, Sheet
from msph.stage.tools import TOOLS, Tool

# Width and padding in text heights.
WIDTH, PAD = 4.6, 0.2


def toolbar(active: Tool, text: int) -> Sheet:
    """Returns the toolbar with the active tool highlighted; text: text height [pixels]."""
    width, pad, pitch = WIDTH * text, PAD * text, LINE * text
    sheet = Sheet((width, pitch * len(TOOLS) + 2.0 * pad), text)
    for k, tool in enumerate(TOOLS):
        label, span = f"{tool.key}  {tool.name}", (pad, width - pad)
        sheet.button(tool.name, label, span, pad + k * pitch, tool is active)
    return sheet
