"""The picture of a window before its first frame."""

import numpy as np

from msph.picture.pixels import as_bytes
from msph.stage.start_screen import BAR, BAR_TOP, BAR_WIDTH, StartScreen

SIZE = WIDTH, HEIGHT = 320, 180


def test_the_bar_grows_and_the_text_changes():
    screen = StartScreen(SIZE, "A pool", (("q", "quit"),))
    pages = {share: as_bytes(screen.paint(share, "compiling")) for share in (0.0, 0.25, 1.0)}
    row = round(HEIGHT * (1.0 - BAR_TOP)) - 2
    for share, page in pages.items():
        assert page.shape == (WIDTH, HEIGHT, 4) and (page[..., 3] == 255).all()
        full = (page[:, row, :3] == BAR).all(axis=1).sum()
        assert abs(full - share * BAR_WIDTH * WIDTH) <= 2
    other = as_bytes(screen.paint(0.25, "reading"))
    assert np.any(other != pages[0.25])
    assert np.array_equal(as_bytes(screen.paint(0.0, "compiling")), pages[0.0])
