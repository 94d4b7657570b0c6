"""Tests of the smoothing of edges in images with one ray per pixel."""

import numpy as np
import pytest

from msph.picture.edge_filter import EdgeFilter
from msph.picture.pixels import TOP, words
from msph.picture.room import PictureRoom, PixelFields
from msph.picture.samples import EVEN, SPAN, STATES, UNEVEN

SIZE = 64, 48
FINE = 16  # subpixels along each axis of the exact image


@pytest.fixture(scope="module")
def edge_filter() -> EdgeFilter:
    return EdgeFilter(PixelFields(PictureRoom(*SIZE)))


def smoothed(edge_filter, image: np.ndarray, whole: bool = True) -> np.ndarray:
    edge_filter.canvas.from_numpy(words(np.repeat(image[..., None], 3, axis=2)))
    edge_filter.smooth(*SIZE, whole)
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
    shading = 0.4 + 0.19 * np.sin(0.1 * x) * np.cos(0.07 * y)
    shading = np.round(shading * TOP) / TOP
    np.testing.assert_allclose(smoothed(edge_filter, shading), shading, atol=1e-6)
    edge = half_plane(0.3, 1)
    assert smoothed(edge_filter, edge).mean() == pytest.approx(edge.mean(), abs=2e-3)


def test_only_uneven_blocks_their_neighbours_and_ends_of_water_are_smoothed(edge_filter):
    edge = half_plane(0.3, 1)
    changed = smoothed(edge_filter, edge) != edge
    state = np.full(edge_filter.state.shape, 2 * STATES + EVEN, np.int32)
    rough = np.zeros(edge_filter.rough.shape, np.int32)
    near = np.zeros((SIZE[0] // SPAN, SIZE[1] // SPAN), bool)
    state[3, 5], state[12:, :] = UNEVEN, 0
    rough[8, 7] = rough[14, 7] = 1  # under and without water
    for a, b in ((3, 5), (14, 7)):
        near[a, b - 1 : b + 2] = near[a - 1 : a + 2, b] = True
    near[11:13] = near[-1:] = near[:, -1:] = True  # beyond the last blocks there is no water
    for field, values in ((edge_filter.state, state), (edge_filter.rough, rough)):
        field.from_numpy(values)
    found = smoothed(edge_filter, edge, whole=False) != edge
    near = near.repeat(SPAN, axis=0).repeat(SPAN, axis=1)
    assert 0 < found.sum() < changed.sum()
    assert np.array_equal(found[:-SPAN, :-SPAN], (changed & near)[:-SPAN, :-SPAN])
