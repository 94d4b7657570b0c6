"""Tests of a camera under water: Snell's window and total reflection."""

import numpy as np
import pytest
from picture_kit import BOX, HEIGHT, LEVEL, WIDTH, canvas_of, covered, items, rays, still_water

from msph.picture.camera import Camera
from msph.picture.look import Look

INDEX = 1.333


@pytest.fixture
def under(picture, mesh):
    """Returns a camera that looks up at still water from 0.3 m below its level."""
    mesh.fill(*still_water())
    picture.load(WIDTH, HEIGHT, BOX, Look(refractive_index=INDEX))
    return Camera(np.array((0.5, LEVEL, 0.5)), 0.3, -1.2, 0.3 / np.sin(1.2), 1.5)


def sees_sky(picture, camera):
    """Returns which pixels (WIDTH, HEIGHT) change with the brightness of the sky, and which pixels
    the sun saturates."""
    shown = []
    for brightness in (0.0, 1.0):
        picture.sky.dome.fill(brightness)
        picture.change(picture.look)
        picture.draw_water(camera)
        shown.append(canvas_of(picture))
    return abs(shown[1] - shown[0]).max(axis=-1) > 0.02, shown[0].min(axis=-1) > 0.9


def test_the_sky_is_seen_in_snells_window_only(picture, under):
    found, dazzled = sees_sky(picture, under)
    eye, d = picture.lens.numbers["eye"], rays(picture.lens.numbers, WIDTH, HEIGHT)
    d /= np.linalg.norm(d, axis=-1, keepdims=True)
    sine = INDEX * np.hypot(d[..., 0], d[..., 2])
    with np.errstate(invalid="ignore"):
        slope = np.sqrt(1.0 - sine**2)
        p = eye + d * ((LEVEL - eye[1]) / d[..., 1])[..., None]
        top = p + d * (INDEX * (BOX[1] - LEVEL) / slope)[..., None]
        over_walls = ((top[..., ::2] > 0.0) & (top[..., ::2] < 1.0)).all(axis=-1)
        near_edge = (abs(top[..., ::2] - 0.5) - 0.5).max(axis=-1)
    window = (d[..., 1] > 0.0) & (sine < 1.0) & over_walls
    sure = (np.isnan(near_edge) | (abs(near_edge) > 0.05)) & ~dazzled
    assert window.sum() > 500 and (~window & (sine < 1.0)).sum() > 500
    assert np.array_equal(found[sure], window[sure])


def test_the_image_changes_only_where_the_eye_crosses_the_surface(picture, mesh):
    mesh.fill(*still_water())
    wet = []
    for eye in (LEVEL + 0.01, LEVEL - 0.01):
        picture.draw_water(Camera(np.array((0.5, eye, 0.4)), 0.0, 0.0, 0.1))
        wet.append(items(picture.raster) == picture.raster.wet[None])
        below = rays(picture.lens.numbers, WIDTH, HEIGHT)[..., 1] < -0.1
        # Above water the lower half shows the surface; under water, the walls in the water.
        assert covered(picture.raster)[below].all()
    assert not wet[0].any()
    assert wet[1][below].all()


def test_water_is_darker_far_below_its_surface(picture, mesh):
    mesh.fill(*still_water())
    picture.load(WIDTH, HEIGHT, BOX, Look(tint=60.0), spacing=1 / 8)
    shown = []
    for height in (0.9 * LEVEL, 0.1 * LEVEL):
        picture.draw_water(Camera(np.array((0.5, height, 0.5)), 0.0, 0.0, 0.4))
        shown.append(canvas_of(picture)[:, HEIGHT // 2].mean())
    assert shown[1] < 0.8 * shown[0]
