"""Tests of images of a paused simulation, which are not drawn anew."""

import numpy as np
import pytest

from msph.launches import watch_launches
from msph.stage.controls import Controls
from msph.stage.show import Show
from tests.scenes_kit import load


@pytest.fixture(scope="module")
def show(tmp_path_factory):
    show = Show(load(tmp_path_factory.mktemp("scene")), 1 / 60, size=(160, 90))
    show.frame(Controls())
    yield show
    show.close()


def frame(show, **controls) -> tuple[set[str], np.ndarray]:
    """Runs a frame; returns the names of the launched kernels, and the image."""
    found = set()
    with watch_launches(lambda owner, name: found.add(f"{type(owner).__name__}.{name}")):
        show.frame(Controls(**controls))
    return found, show.display.picture.image.to_numpy()


def test_paused_water_is_drawn_only_if_the_view_changes(show):
    _, moving = frame(show)
    kernels, paused = frame(show, still=True)
    assert kernels.isdisjoint({"Surface.extract", "Picture.rasterise", "BlockSampler.trace"})
    assert np.array_equal(moving, paused)
    show.display.camera.orbit(0.1, 0.0)
    kernels, turned = frame(show, still=True)
    assert "Picture.rasterise" in kernels and abs(turned - paused).max() > 0.1


def test_new_time_a_reset_another_view_and_a_parameter_are_drawn(show):
    assert "Picture.rasterise" in frame(show)[0]
    assert "Picture.rasterise" in frame(show, still=True, reset=True)[0]
    assert "Picture.rasterise" in frame(show, still=True, set={"picture.tint": 8.0})[0]
    show.display.views.next()
    assert "ParticlesView.draw" in frame(show, still=True)[0]
    show.display.views.name = "water"
    assert "Picture.rasterise" in frame(show, still=True)[0]
    assert "Picture.rasterise" not in frame(show, still=True)[0]


def test_a_checkpoint_of_other_water_at_the_same_time_is_drawn(show, tmp_path):
    frame(show)
    assert "Picture.rasterise" not in frame(show, still=True)[0]
    show.keep(tmp_path / "kept.npz")
    show.resume(tmp_path / "kept.npz")
    assert "Picture.rasterise" in frame(show, still=True)[0]


def test_panels_over_a_repeated_image_are_removed(show):
    _, before = frame(show, still=True)
    show.display.picture.image.field.fill(0.5)
    assert np.array_equal(frame(show, still=True)[1], before)
