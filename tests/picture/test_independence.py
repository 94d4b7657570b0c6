"""Tests that a picture loads other boxes, looks, sizes and bodies without compiling kernels, and
that its images do not depend on the images before them."""

import numpy as np
import pytest
import taichi as ti
from picture_kit import BOX, LAYER, ball

from msph.fluid.boundary.rigid_bodies import Ball
from msph.launches import watch_compiling
from msph.picture.camera import Camera
from msph.picture.legend import Legend
from msph.picture.look import Look
from msph.picture.room import PictureRoom
from msph.taichi_internals import PLAIN
from tests.boundary_kit import boundary_of

LEGEND = Legend("speed [m/s]", ((0.0, "0"), (1.0, "2")))
FLAT, TALL = (0.9, 0.5, 0.7), (0.6, 1.2, 0.5)
# Size, box, look and scale of each image.
IMAGES = [
    ((96, 54), BOX, Look(), 0.5),
    ((96, 54), BOX, Look(), 1.0),
    ((64, 48), BOX, Look(supersample=2), 1.0),
    ((160, 120), FLAT, Look(tint=9.0, reflection=0.3), 1.0),
    ((90, 110), TALL, Look(caustics=False, sun_azimuth=1.0, sun_elevation=5.0), 0.6),
    ((50, 40), TALL, Look(supersample=3, refractive_index=1.2), 1.0),
]


@pytest.fixture(scope="module")
def spheres():
    x, value, radius = ti.Vector.field(3, ti.f32, 8), ti.field(ti.f32, 8), ti.field(ti.f32, 8)
    x.from_numpy(np.random.default_rng(1).uniform(0.1, 0.5, (8, 3)).astype(np.float32))
    value.from_numpy(np.linspace(0, 1, 8, dtype=np.float32))
    radius.fill(0.05)
    return x, value, radius


def draw(picture, image, spheres):
    """Returns the image of the water and the image of the particles."""
    size, box, look, scale = image
    picture.load(*size, box, look)
    picture.scale = scale
    x, value, radius = spheres
    view, shown = Camera.framing(box, size[0] / size[1]), []
    picture.draw_water(view)
    shown.append(picture.image.to_numpy())
    picture.draw_particles(view, None, x, value, 0.0, 1.0, 8, radius, LEGEND)
    shown.append(picture.image.to_numpy())
    assert picture.to_numpy_u8().shape == (size[1], size[0], 3)
    return shown


BODIES = [[], [Ball(np.array((0.4, 0.3, 0.2)), 0.1)]]


@pytest.mark.parametrize("bodies", BODIES)
def test_other_scenes_and_sizes_compile_no_kernels_and_repeat_their_images(
    picture, spheres, bodies
):
    picture.mesh.fill(*ball((0.3, 0.3, 0.35), 0.2))
    boundary_of(FLAT, [LAYER], bodies)
    first = draw(picture, IMAGES[-1], spheres)
    for image in IMAGES[:3]:
        draw(picture, image, spheres)
    compiled = []
    with watch_compiling(compiled.append):
        for image in IMAGES[3:]:
            last = draw(picture, image, spheres)
    assert PLAIN or not compiled
    for one, other in zip(first, last, strict=True):
        assert one.std() > 0.05
        np.testing.assert_allclose(one, other, atol=1 / 255)


def test_sky_and_ground_do_not_depend_on_the_images_before(picture):
    """Regression: samples kept their values if they were within 1e-4 of those of another scene."""
    size, found = (96, 54), []
    for elevations in ([0.6, 0.3], [0.6, 0.30002, 0.3]):
        for elevation in elevations:
            picture.load(*size, BOX)
            picture.draw_water(Camera.framing(BOX, size[0] / size[1], 0.6, elevation))
        found.append(picture.fields.background.to_numpy()[:12, :7])
    assert np.array_equal(*found)


def test_sizes_of_images_are_rounded_up_to_rooms():
    assert PictureRoom.holding(640, 360) == PictureRoom.holding(960, 544) == PictureRoom()
    assert PictureRoom.holding(961, 90) == PictureRoom(1920, 544)
    assert PictureRoom.holding(1280, 720, rays=3) == PictureRoom(3840, 2176)
    assert PictureRoom.holding(2560, 1440) == PictureRoom(2880, 1632)
    assert not PictureRoom().holds(1000, 500, rays=3)


def test_image_that_exceeds_the_room_is_refused(picture):
    with pytest.raises(ValueError, match="exceed"):
        picture.load(picture.room.width + 1, 36, BOX)
