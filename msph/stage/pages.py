"""Pages over the window's image: lines, hints, help, and the toolbar."""

import numpy as np

from msph.stage.keys import KEYS
from msph.stage.sheet import FAINT, LINE, PADDING, SOLID, WARNING, Sheet, font_of
from msph.stage.tools import TOOLS, Tool

# In text heights: width of the column of keys in the help; width and padding of the toolbar.
KEY_WIDTH, TOOLBAR, PAD = 10.0, 4.6, 0.2


def lines(texts: list[tuple[str, tuple]], size: int) -> Sheet:
    """Returns a page of lines with their colours; size: text height [pixels]."""
    pad = round(PADDING * size)
    width = max(int(font_of(size).getlength(text)) for text, _ in texts) + 2 * pad
    sheet = Sheet((width, round(LINE * size * len(texts)) + pad), size)
    for row, (text, colour) in enumerate(texts):
        sheet.write(pad, 0.5 * pad + sheet.pitch * row, text, colour)
    return sheet


def hints(texts: list[str], urgent: bool, size: int, most: float) -> Sheet:
    """Returns a page with one line of hints: the first hint and as many more as fit into `most`
    pixels. Highlights the first if urgent; size: text height [pixels]."""
    pad, between = round(PADDING * size), 1.5 * size
    ends = np.cumsum([font_of(size).getlength(text) + between for text in texts]) + pad
    fit = max(1, int(np.sum(ends - between + pad <= most)))
    sheet = Sheet((int(ends[fit - 1] - between) + pad, round(LINE * size) + pad), size)
    for k, (x, text) in enumerate(zip([pad, *ends], texts[:fit], strict=False)):
        sheet.write(x, 0.5 * pad, text, WARNING if urgent and k == 0 else FAINT)
    return sheet


def help_page(size: int, most: int, taken: frozenset[str] = frozenset()) -> Sheet:
    """Returns the page of all keys not `taken` by a lesson. size: text height [pixels], reduced if
    the page would be higher than `most` [pixels]."""
    rows = [(key.label, key.effect) for key in KEYS if not taken & set(key.keys)]
    size = min(size, int(most / (LINE * (len(rows) + 1) + 2.0 * PADDING)))
    pad, column = round(2.0 * PADDING * size), KEY_WIDTH * size
    widest = max(font_of(size).getlength(effect) for _, effect in rows)
    high = round(LINE * size * (len(rows) + 1)) + 2 * pad
    sheet = Sheet((int(column + widest) + 2 * pad, high), size, SOLID)
    sheet.write(pad, pad, "Keys and mouse (h closes)", WARNING)
    for row, (label, effect) in enumerate(rows, 1):
        y = pad + sheet.pitch * row
        sheet.write(pad, y, label)
        sheet.write(pad + column, y, effect, FAINT)
    return sheet


def toolbar(active: Tool, text: int) -> Sheet:
    """Returns a column of buttons, one for each tool, with the active one highlighted; text: text
    height [pixels]."""
    width, pad, pitch = TOOLBAR * text, PAD * text, LINE * text
    sheet = Sheet((width, pitch * len(TOOLS) + 2.0 * pad), text)
    for k, tool in enumerate(TOOLS):
        label, span = f"{tool.key}  {tool.name}", (pad, width - pad)
        sheet.button(tool.name, label, span, pad + k * pitch, tool is active)
    return sheet
