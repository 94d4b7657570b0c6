"""Tests of images that are rendered with fewer pixels and upscaled."""

import numpy as np
import pytest
from picture_kit import BOX, HEIGHT, WIDTH, still_water

from msph.picture.camera import Camera
from msph.picture.enlarger import Enlarger
from msph.picture.room import PictureRoom, PixelFields


@pytest.fixture(scope="module")
def enlarger() -> Enlarger:
    return Enlarger(PixelFields(PictureRoom(48, 32)))


@pytest.mark.parametrize(("columns", "rows"), [(48, 32), (37, 21), (24, 16)])
def test_linear_images_are_upscaled_exactly(enlarger, columns, rows):
    """Cubic convolution reproduces linear images, except where it needs pixels beyond the edge."""
    x, y = np.meshgrid((np.arange(48) + 0.5), (np.arange(32) + 0.5), indexing="ij")

    def ramp(x, y):
        return np.stack([0.2 + 0.6 * x, 0.1 + 0.7 * y, 0.5 + 0.2 * (x - y)], axis=-1)

    small = np.full((48, 32, 3), np.nan, np.float32)
    small[:columns, :rows] = ramp(x / columns, y / rows)[:columns, :rows]
    enlarger.resolved.from_numpy(small)
    enlarger.enlarge(columns, rows, 48, 32)
    found, wanted = enlarger.resolved.to_numpy(), ramp(x / 48, y / 32)
    assert np.isfinite(found).all()
    np.testing.assert_allclose(found[4:-4, 4:-4], wanted[4:-4, 4:-4], atol=1e-5)
    np.testing.assert_allclose(found, wanted, atol=0.03)


def test_upscaled_images_are_close_and_full_scale_is_restored(picture, mesh):
    mesh.fill(*still_water())
    view = Camera.framing(BOX, WIDTH / HEIGHT)
    pictures, picked = {}, {}
    for scale in (1.0, 0.7, 0.5, 1.0):
        picture.scale = scale
        for _ in range(2):  # the second frame of a view renders its whole backdrop
            picture.draw_water(view)
        again = pictures.get(scale)
        pictures[scale] = picture.image.to_numpy()
        picked[scale] = picture.pick(WIDTH // 2, HEIGHT // 2)
        assert pictures[scale].shape == (WIDTH, HEIGHT, 3)
    np.testing.assert_array_equal(pictures[1.0], again)
    errors = [np.abs(pictures[s] - pictures[1.0]).mean() for s in (0.7, 0.5)]
    assert 0.0 < errors[0] < errors[1] < 0.02
    # Both scales pick the same point on the water, to one pixel.
    assert np.linalg.norm(picked[0.5] - picked[1.0]) < 0.02
