"""Tests of the start screen, the image of a window before its first frame."""

import numpy as np

from msph.picture.pixels import as_bytes
from msph.stage.start_screen import StartScreen

SIZE = WIDTH, HEIGHT = 320, 180


def test_only_the_progress_text_changes():
    screen = StartScreen(SIZE, "A pool", (("q", "quit"),))
    first, other = (as_bytes(screen.paint(doing)) for doing in ("compiling a", "compiling b"))
    assert first.shape == (WIDTH, HEIGHT, 4) and (first[..., 3] == 255).all()
    changed = np.any(first != other, axis=-1)
    assert 0.0 < changed.mean() < 0.02
    assert np.array_equal(as_bytes(screen.paint("compiling a")), first)
