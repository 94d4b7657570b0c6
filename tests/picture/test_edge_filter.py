"""Tests of the smoothing of edges in images with one ray per pixel."""

import numpy as np
import pytest

from msph.picture.edge_filter import EdgeFilter
from msph.picture.room import PictureRoom, PixelFields

SIZE = 64, 48
FINE = 16  # subpixels along each axis of the exact image


@pytest.fixture(scope="module")
def edge_filter() -> EdgeFilter:
    return EdgeFilter(PixelFields(PictureRoom(*SIZE)))


def smoothed(edge_filter, image: np.ndarray) -> np.ndarray:
    edge_filter.canvas.from_numpy(np.repeat(image[..., None], 3, axis=2).astype(np.float32))
    edge_filter.smooth(*SIZE)
    return edge_filter.resolved.to_numpy()[..., 0]


def half_plane(slope: float, samples: int) -> np.ndarray:
    """Returns the share of each pixel below the line y = 20 + slope x, from samples x samples
    points."""
    places = (np.arange(samples) + 0.5) / samples
    x, y = (np.add.outer(np.arange(n), places).ravel() for n in SIZE)
    dark = (y[None, :] < 20.0 + slope * x[:, None]).astype(float)
    return dark.reshape(SIZE[0], samples, SIZE[1], samples).mean(axis=(1, 3))


@pytest.mark.parametrize("slope", [0.15, 0.4, -0.25])
def test_smoothing_brings_edges_closer_to_the_exact_image(edge_filter, slope):
    exact, one_ray = half_plane(slope, FINE), half_plane(slope, 1)
    errors = [
        np.sqrt(((image - exact) ** 2).mean())
        for image in (one_ray, smoothed(edge_filter, one_ray))
    ]
    assert errors[1] < 0.92 * errors[0]


def test_smooth_shading_and_the_mean_of_edges_are_unchanged(edge_filter):
    x, y = np.meshgrid(*(np.arange(n) for n in SIZE), indexing="ij")
    shading = 0.4 + 0.2 * np.sin(0.1 * x) * np.cos(0.07 * y)
    np.testing.assert_allclose(smoothed(edge_filter, shading), shading, atol=1e-6)
    edge = half_plane(0.3, 1)
    assert smoothed(edge_filter, edge).mean() == pytest.approx(edge.mean(), abs=2e-3)
