"""Fixtures for tests of keys and gestures: a show and a player that runs it, and a virtual
screen."""

import math

import pytest

from msph.measure.timings import Timings
from msph.scene.live import live_parameters, read
from msph.stage.layout import PAGES, Layout
from msph.stage.pacer import Pacer
from msph.stage.show import INTERACTIVE, Show
from tests.scenes_kit import POOL, WATER, load
from tests.stage.player_kit import FRAME, SIZE, Asked, played


# Each file returns its fields to the stock, so that the next file compiles nothing.
@pytest.fixture(scope="module")
def show(tmp_path_factory):
    """Yields a show of viscous water, which has more live parameters."""
    viscous = f"{POOL}[projection]\nviscosity = 1.0\n{WATER}"
    scene = load(tmp_path_factory.mktemp("scene"), viscous, "adaptation.enabled=true")
    show = Show(scene, FRAME, SIZE, timings=Timings(keep=1), **INTERACTIVE)
    yield show
    show.close()


@pytest.fixture
def given(show):
    """Yields the show at its start; restores its scene and live parameters afterwards."""
    scene = show.scene
    show.reset()
    show.display.views.name, show.display.camera = "water", show.display.framing()
    show.display.views.neighbourhood.pick(None)
    show.display.views.cut = None
    yield show
    for live in live_parameters(scene):
        show.set(live.key, read(scene, live.key))
    show.scene = scene


@pytest.fixture(scope="package")
def layout():
    """Returns the layout that all players share, as in a session."""
    return Layout(SIZE)


@pytest.fixture
def player(given, layout, tmp_path, monkeypatch):
    """Returns a player whose frames simulate FRAME [s] each, however busy the machine is.

    Regression: on a busy machine a tool was used for a third of the time, with too little effect.
    """
    monkeypatch.setattr(Pacer, "frame_time", FRAME)
    monkeypatch.setattr(Pacer, "budget", math.inf)
    # Left open by an earlier test.
    layout.panel, layout.page = "", PAGES[0]
    player = played(Asked([given]), layout)
    player.saver.folder = tmp_path
    return player


@pytest.fixture(scope="module")
def display(tmp_path_factory):
    """Yields a virtual screen for real windows."""
    from tests.stage.window_kit import virtual_screen  # fails where its programs are required

    with virtual_screen(tmp_path_factory.mktemp("screen")) as (screen, _):
        yield screen
