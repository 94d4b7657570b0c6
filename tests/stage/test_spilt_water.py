"""Tests of spilt water in shows, which is rendered as drops outside the box."""

import numpy as np
import pytest

from msph.scene import load_scene
from msph.stage.controls import Controls
from msph.stage.show import Show

SIZE = (160, 120)


@pytest.fixture(scope="module")
def shared():
    changes = ("box.size=[0.6, 0.36, 0.6]", "layers.0.spacing=0.06", "picture.whitewater=false")
    show = Show(load_scene("still", changes), 1 / 60, size=SIZE)
    yield show
    show.close()


@pytest.fixture
def show(shared):
    shared.reset()
    return shared


# The next test runs before `show` is built, and uses its fields.
def test_an_interactive_scene_begins_again_when_all_water_is_spilt():
    """Regression: the window was closed."""
    changes = ("box.size=[0.6, 0.36, 0.6]", "layers.0.spacing=0.06", "gravity=[0, 20, 0]")
    show = Show(load_scene("still", changes), 1 / 20, stop_bodies=True)
    for _ in range(40):
        show.frame(Controls())
        if show.note:
            break
    assert show.note == "all water has left the box: the scene begins again"
    assert show.simulation.rim.mass == 0.0
    assert show.simulation.particles.count == len(show.simulation.initial["x"])
    show.close()


def image(show, *places) -> np.ndarray:
    """Returns the image of a show with drops at `places` [m]."""
    n = len(places)
    drops = {"x": np.array(places).reshape(n, 3), "v": np.zeros((n, 3))}
    drops |= {"radius": np.full(n, 0.03), "life": np.ones(n)}
    show.simulation.rim.drops.fill(**drops)
    show.simulation.rim.mass = float(n)  # any water outside, so that drops are drawn
    show.frame(Controls(still=True))
    return show.display.picture.to_numpy_u8().astype(int)


def pixel(show, place) -> tuple[int, int]:
    """Returns row and column of a point [m] in the image."""
    (right, up), *_ = show.display.camera.project(
        np.array([place]), *SIZE, show.simulation.size, show.pose.tilt
    )
    return int((1.0 - up) * SIZE[1]), int(right * SIZE[0])


def test_a_drop_is_rendered_at_its_position(show):
    eye = show.display.camera.eye
    # Outside the box, on the side of the camera.
    place = (0.3 + 0.45 * np.sign(eye[0] - 0.3), 0.2, 0.3)
    without, found = image(show), image(show, place)
    changed = np.argwhere(np.abs(found - without).max(axis=2) > 3)
    assert 5 < len(changed) < 0.05 * found.shape[0] * found.shape[1]
    assert np.abs(changed - pixel(show, place)).max() < 12


def test_tiles_hide_drops_behind_them(show):
    side = np.sign(show.display.camera.eye[0] - 0.3)
    assert np.array_equal(image(show), image(show, (0.3 - 0.4 * side, 0.1, 0.3)))


def test_a_reset_removes_drops_and_spilt_mass(show):
    for _ in range(20):
        show.frame(Controls(tilt=(-0.7, 0.0)))
    rim = show.simulation.rim
    assert rim.mass > 0.0 and (rim.drops.life.to_numpy() > 0.0).any()
    show.reset()
    assert rim.mass == 0.0 and not (rim.drops.life.to_numpy() > 0.0).any()
