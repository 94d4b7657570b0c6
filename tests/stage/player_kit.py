"""Test double of a window, and helpers that run a player in it."""

import contextlib
import itertools
from dataclasses import replace

import numpy as np

from msph.stage.choice import Choice, SceneArguments
from msph.stage.controls import Inputs
from msph.stage.player import Player
from msph.stage.row import Row

SIZE = WIDTH, HEIGHT = 480, 270
FRAME = 1 / 60


class Screen:
    """Test double of a window: pressed and held keys and buttons, and a cursor."""

    def __init__(self):
        self.size, self.open, self.aspect = SIZE, True, WIDTH / HEIGHT
        self.pressed, self.held = [], set()
        self.at, self.marks, self.image = np.array([0.5, 0.4]), 0, None
        self.arrowed = None

    def presses(self):
        pressed, self.pressed = self.pressed, []
        return pressed

    def down(self, *keys):
        return any(key in self.held for key in keys)

    @contextlib.contextmanager
    def holding(self, *keys, at=None):
        """Holds keys and buttons down, with the cursor at a position if given."""
        self.at, self.held = self.at if at is None else at, set(keys)
        yield
        self.held = set()

    def cursor(self):
        return self.at.copy()

    def mark(self, cursor):
        self.marks += 1

    def arrows(self, places):
        self.arrowed = places

    def show(self, image):
        self.image = image


class Stopwatch:
    """Test double of a clock that only sleep() advances."""

    def __init__(self):
        self.time = 0.0

    def __call__(self):
        return self.time

    def sleep(self, seconds):
        self.time += seconds


class Asked(Row):
    """Row that applies changes and resets with the next input, as in another process."""

    def __init__(self, *given):
        super().__init__(*given)
        self.given = Inputs()

    def set(self, key, value):
        self.given.set[key] = value

    def reset(self):
        self.given.reset = True


class Sender(Player):
    """Player whose input contains what it asks of an Asked row."""

    def controls(self, row):
        controls, given = super().controls(row), row.given
        row.given = Inputs()
        return replace(controls, set=given.set, reset=given.reset)


def frames(player, number=1):
    """Runs frames of a player and its row; returns the last image, (width, height, 3)."""
    for _ in range(number):
        player.row.frame(player.controls(player.row))
        player.observe(player.row)
    return player.window.image.to_numpy()


def press(player, *keys, number=1):
    player.window.pressed += keys
    return frames(player, number)


def drag(player, right, up, number):
    """Moves the cursor by shares of the window before each of a number of frames."""
    for _ in range(number):
        player.window.at = player.window.at + np.array([right, up])
        frames(player)


def wet_pixels(show):
    """Returns pixels (right, up) of the image that show water, and the points [m] of its surface;
    every twelfth pixel along both axes, since each takes a launch."""
    width, height = show.display.picture.size
    pixels = itertools.product(range(0, width, 12), range(0, height, 12))
    hits = ((pixel, show.display.pick(*pixel)) for pixel in pixels)
    return [(pixel, x) for pixel, x in hits if x is not None]


def wet_place(show):
    """Returns a position on the water's surface in the left half of the box, (right, up) in shares
    of the window."""
    hits = wet_pixels(show)
    level, middle = max(x[1] for _, x in hits), 0.5 * show.simulation.size[0]
    wet = [pixel for pixel, x in hits if x[1] > 0.9 * level and x[0] < middle]
    return np.array(wet[len(wet) // 2]) / SIZE


def played(row, layout, *, screen=None, choice=None):
    choice = replace(choice or Choice("pool", "auto"), found="medium")
    kind = Sender if isinstance(row, Asked) else Player
    return kind(screen or Screen(), row, choice, layout, SceneArguments("pool"))
