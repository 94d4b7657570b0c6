"""Toolbar: a column of buttons at the right edge of the window, one for each tool."""

from typing import Any

import numpy as np
from PIL import Image, ImageDraw

from msph.stage.layout import Layout
from msph.stage.pages import GROUND, LINE, font_of
from msph.stage.tools import TOOLS, Tool
from msph.stage.widgets import Grip, Sheet

# Width and padding in text heights.
WIDTH, PAD = 4.6, 0.2


class Toolbar:
    """Buttons of the tools, the active one highlighted."""

    def __init__(self, layout: Layout):
        self.layout, self.grip = layout, Grip()
        self.sheet: Sheet | None = None
        self.painted: Any = None

    def draw(self, tool: Tool) -> None:
        """Shows the toolbar; repaints it if another tool is active."""
        if tool.name == self.painted:
            return
        self.painted, text = tool.name, self.layout.text
        width, pad, pitch = WIDTH * text, PAD * text, LINE * text
        height = pitch * len(TOOLS) + 2.0 * pad
        page = Image.new("RGBA", (round(width), round(height)), GROUND)
        self.sheet = Sheet(ImageDraw.Draw(page), font_of(text), text)
        for k, each in enumerate(TOOLS):
            label, span = f"{each.key}  {each.name}", (pad, width - pad)
            self.sheet.button(each.name, label, span, pad + k * pitch, each is tool)
        self.layout.put_tools(np.asarray(page))

    def touch(self, cursor: np.ndarray, down: bool, pressed: bool) -> str:
        """Returns the name of the tool whose button was clicked, "" for none; cursor: (right, up)
        in shares of the window."""
        x, y = self.layout.on_tools(cursor)
        acted = self.grip.act(self.sheet, x, y, down, pressed)
        return acted.name if acted else ""
