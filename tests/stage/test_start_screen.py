"""Tests of the start screen, the image of a window before its first frame."""

import numpy as np

from msph.picture.pixels import as_bytes
from msph.stage.start_screen import LEFT, StartScreen

SIZE = WIDTH, HEIGHT = 320, 180


def test_only_the_progress_text_changes():
    screen = StartScreen(SIZE, "A pool", (("q", "quit"),))
    first, other = (as_bytes(screen.paint(doing)) for doing in ("compiling a", "compiling b"))
    assert first.shape == (WIDTH, HEIGHT, 4) and (first[..., 3] == 255).all()
    changed = np.any(first != other, axis=-1)
    assert 0.0 < changed.mean() < 0.02
    assert np.array_equal(as_bytes(screen.paint("compiling a")), first)


def test_long_progress_is_wrapped_within_the_window():
    """Regression: a list of waiting keys ran out of the window."""
    screen = StartScreen(SIZE, "A pool", ())
    changed = screen.paint("compiling; then: " + "Right, " * 200) != screen.paint("")
    across = np.flatnonzero(changed.any(axis=1))
    assert LEFT * SIZE[0] - 2 < across[0] and across[-1] < (1.0 - LEFT) * SIZE[0] + 2
