"""A player and the show that it plays, for tests of what keys and gestures do."""

import pytest

from msph.measure.timings import Timings
from msph.scene import load_scene
from msph.scene.live import live_parameters, read
from msph.stage.layout import Layout
from msph.stage.row import Row
from msph.stage.show import INTERACTIVE, Show
from tests.scenes_kit import TEXT, WATER, write
from tests.stage.player_kit import FRAME, SIZE, played


@pytest.fixture(scope="package")
def show(tmp_path_factory):
    """Viscous water, so that more parameters are live."""
    path = write(
        tmp_path_factory.mktemp("scene"),
        f"""{TEXT.split("[classic]")[0]}
[projection]
viscosity = 1.0
{WATER}""",
    )
    scene = load_scene(path, ("method=projection", "adaptation.enabled=true"))
    return Show(scene, FRAME, SIZE, timings=Timings(keep=1), **INTERACTIVE)


@pytest.fixture
def given(show):
    """The show at its start, with the scene as it was."""
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
    """One for all players, as in a session."""
    return Layout(SIZE)


@pytest.fixture
def player(given, layout, tmp_path):
    player = played(Row([given]), layout)
    player.saver.folder = tmp_path
    return player
