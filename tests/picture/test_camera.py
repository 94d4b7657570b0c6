import numpy as np
import pytest

from msph.picture.camera import CLEARANCE, ELEVATION, Camera
from msph.picture.look import Look
from msph.picture.shot import shot_numbers

BOX = (1.6, 0.9, 0.6)


@pytest.mark.parametrize("box", [(1, 1, 1), BOX, (0.3, 2.0, 0.3)])
@pytest.mark.parametrize("azimuth", [0.0, 0.6, 2.5])
def test_framing_shows_every_corner(box, azimuth):
    width, height = 640, 360
    shot = shot_numbers(
        Camera.framing(box, width / height, azimuth), None, box, width, height, Look()
    )
    corners = np.indices((2, 2, 2)).reshape(3, 8).T * box - shot["eye"]
    depth = corners @ shot["forward"]
    assert depth.min() > 0
    i = corners @ shot["to_i"] / depth + shot["centre"][0]
    j = corners @ shot["to_j"] / depth + shot["centre"][1]
    assert i.min() > 0 and i.max() < width and j.min() > 0 and j.max() < height
    assert max(np.ptp(i) / width, np.ptp(j) / height) > 0.6, "the box should fill the picture"


def test_ray_through_the_middle_meets_the_target():
    camera = Camera(np.array((0.3, 0.2, 0.1)), azimuth=1.0, elevation=0.5, distance=2.0)
    eye, d = camera.ray(49.5, 24.5, 100, 50)
    np.testing.assert_allclose(eye + 2.0 * d, camera.target, atol=1e-12)


def test_the_axes_of_the_image_point_right_and_up():
    camera = Camera(azimuth=0.0, elevation=0.1)  # looks along -z
    _, right = camera.ray(99, 24.5, 100, 50)
    _, up = camera.ray(49.5, 49, 100, 50)
    assert right[0] > 0.1 and up[1] > 0


def test_orbit_and_zoom_stay_within_limits():
    camera = Camera.framing(BOX)
    camera.orbit(10.0, 9.0)
    assert camera.elevation == pytest.approx(ELEVATION[1]) and 0 <= camera.azimuth < 2 * np.pi
    camera.orbit(0.0, -9.0)
    assert camera.elevation < 0.0 and camera.eye[1] == pytest.approx(CLEARANCE * BOX[1])
    for factor, limit in ((1e-3, 0), (1e6, 1)):
        camera.zoom(factor)
        assert camera.distance == pytest.approx(camera.reach[limit])


def test_box_ray_of_a_tilted_box_is_the_world_ray_rotated_back():
    a = 0.3
    tilt = np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]])
    camera, C = Camera.framing(BOX), np.array(BOX) / 2
    eye, d = camera.ray(10, 20, 64, 36)
    eye_box, d_box = camera.box_ray(10, 20, 64, 36, BOX, tilt)
    np.testing.assert_allclose(C + tilt @ (eye_box + 0.7 * d_box - C), eye + 0.7 * d, atol=1e-12)
    (found,) = camera.project([eye_box + 0.7 * d_box], 64, 36, BOX, tilt)
    np.testing.assert_allclose(found * (64, 36), (10.5, 20.5), atol=1e-9)


def test_shot_rays_are_the_cameras_rays():
    camera, tilt = Camera.framing(BOX), np.array([[0, 0, 1], [0, 1, 0], [-1, 0, 0]], float)
    shot = shot_numbers(camera, tilt, BOX, 64, 36, Look())
    d = shot["origin"] + 5 * shot["du"] + 30 * shot["dv"]
    eye, want = camera.box_ray(5, 30, 64, 36, BOX, tilt)
    np.testing.assert_allclose(d / np.linalg.norm(d), want, atol=1e-12)
    np.testing.assert_allclose(shot["eye"], eye)
