"""Window loop of a lesson with a board."""

from msph.lesson.board_view import BoardView
from msph.lesson.guide import Guide
from msph.stage.controls import ACTIONS
from msph.stage.window import Window


def read(window: Window, guide: Guide, frames: int | None = None) -> None:
    """Shows a board and its lesson until the window is closed or after `frames` frames."""
    view, done = BoardView(window.size, guide.below), 0
    while window.open and (frames is None or done < frames):
        pressed = window.presses()
        for key in pressed:
            if not guide.handle_key(key) and ACTIONS.get(key) == "quit":
                return
        guide.drag(window.cursor(), window.down("LMB"), "LMB" in pressed)
        guide.update()
        view.draw(guide.progress)
        guide.draw(view.image)
        window.show(view.image)
        done += 1
