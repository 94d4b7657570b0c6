"""Tests of the camera path: its key frames, and refused paths."""

import numpy as np
import pytest

from msph.scene import load_scene
from msph.scene.camera_path import orbit_at

KEYS = (
    "camera.path=[{time=1.0, azimuth=10.0}, "
    "{time=2.0, azimuth=90.0, elevation=40.0, zoom=2.0, target=[0.1, 0.2, 0.3]}]"
)
CENTRE = 0.5, 0.6, 0.7


def test_camera_passes_its_key_frames_and_turns_in_one_direction():
    camera = load_scene("drop", (KEYS,)).camera
    at = [orbit_at(camera, t, CENTRE) for t in (0.0, 1.0, 2.0, 9.0)]
    assert at[0] == at[1] == (10.0, 21.0, 1.0, CENTRE)
    assert at[2] == at[3] and at[2][:3] == (90.0, 40.0, 2.0)
    assert at[2][3] == pytest.approx((0.1, 0.2, 0.3))
    turned = [orbit_at(camera, t, CENTRE)[0] for t in np.linspace(1.0, 2.0, 20)]
    assert (np.diff(turned) > 0.0).all()


def test_without_a_path_the_camera_stays():
    camera = load_scene("drop").camera
    given = camera.azimuth, camera.elevation, camera.zoom, CENTRE
    assert orbit_at(camera, 5.0, CENTRE) == given
