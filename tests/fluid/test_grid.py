"""Scan, sort, grid and neighbour list, compared with brute force."""

import numpy as np
import pytest
import taichi as ti

from msph.fluid.boundary.walls import wall_constants
from msph.fluid.constants import Constants
from msph.fluid.particles.grid import Z_CELLS, LayeredGrid, cells_of, grid_rows
from msph.fluid.particles.layers import Layers, LayerSpec
from msph.fluid.particles.neighbour_list import (
    PAIR_REACH,
    NeighbourList,
    NeighbourOverflowError,
    list_capacity,
    list_tables,
    max_mean_neighbours,
)
from msph.fluid.particles.particles import Attribute, Particles
from msph.fluid.particles.prefix_sum import CHUNKS, PrefixSum
from msph.fluid.room import FIRST

FORMS = ["scatter", "pair", "widest"]
MARGINS = {"scatter": 0.3, "pair": 0.1, "widest": 0.0}
SIZE = (1.0, 0.7, 0.33)
COUNT = 600
TAG = Attribute("tag", "-", "rides along with the sort")


def cloud(seed):
    """Returns random positions [m] and layers of particles: 150 in corners of the box, 100 on two
    opposite faces, 100 on four parallel edges, the others anywhere."""
    rng = np.random.default_rng(seed)
    x = rng.uniform(0.0, 1.0, (COUNT, 3))
    x[:150] = np.round(x[:150])
    x[150:250, seed % 3] = np.round(x[150:250, seed % 3])
    ends = np.arange(3) != seed % 3
    x[250:350, ends] = np.round(x[250:350, ends])
    return (x * SIZE).astype(np.float32), rng.integers(0, 3, COUNT).astype(np.int32)


class World:
    """Particles in a grid with a neighbour list of any form."""

    def __init__(self, size=SIZE, masses=(1.0, 0.25, 3.0), smoothing=2.03):
        # The default support radii are about 0.2, 0.12 and 0.3 m, none of which divides the box.
        self.specs = [LayerSpec(m, 1000.0, smoothing) for m in masses]
        self.size = size
        self.constants, self.layers = Constants(), Layers()
        self.particles = Particles(FIRST.particles, (TAG,))
        self.grid = LayeredGrid(FIRST, self.constants, self.layers, self.particles)
        self.neighbours = NeighbourList(FIRST, self.grid)
        self.particles.capacity = COUNT + 50
        self.list_of("pair")

    def list_of(self, form):
        """Returns the list, set up for a form; find() has yet to be called."""
        margin = MARGINS[form]
        rows, pairs = list_tables(self.specs, margin, form)
        self.layers.load(self.specs, rows | grid_rows(self.size, self.specs), pairs)
        most = self.particles.capacity
        entries = list_capacity(self.specs, margin, form, most)
        self.cells = sum(cells_of(self.size, self.specs))
        self.usual = max_mean_neighbours(self.specs, margin, form)
        self.constants.fill(
            **wall_constants(self.size, False),
            layers=len(self.specs),
            cells=self.cells,
            entries=entries,
            mean_neighbours=self.usual,
        )
        self.neighbours.load(entries, margin * self.layers.finest.support)
        return self.neighbours

    def place(self, x, layer):
        self.particles.fill(x=x, layer=layer, tag=np.arange(len(x), dtype=np.float32))
        self.grid.build()


@pytest.fixture(scope="module")
def world():
    return World()


@pytest.mark.parametrize("serial", [True, False])
@pytest.mark.parametrize("length", [1, CHUNKS - 1, CHUNKS, CHUNKS + 1, 5 * CHUNKS + 17])
def test_scan_is_the_cumulative_sum(length, serial):
    counts = np.random.default_rng(length).integers(0, 9, length).astype(np.int32)
    source, target = ti.field(ti.i32, shape=length), ti.field(ti.i32, shape=length + 1)
    source.from_numpy(counts)
    scan = PrefixSum()
    scan.serial = serial
    scan.run(source, target, length)
    assert np.array_equal(target.to_numpy(), np.concatenate([[0], np.cumsum(counts)]))


def test_sort_moves_all_attributes_of_a_particle_together_into_its_cell(world):
    x, layer = cloud(0)
    world.place(x, layer)
    order = world.particles.numpy("id")
    assert sorted(order) == list(range(COUNT))
    sorted_x, sorted_layer = world.particles.numpy("x"), world.particles.numpy("layer")
    assert np.array_equal(sorted_x, x[order]) and np.array_equal(sorted_layer, layer[order])
    assert np.array_equal(world.particles.numpy("tag"), order.astype(np.float32))
    assert np.all(np.diff(sorted_layer) >= 0)
    start = world.grid.cell_start.to_numpy()[: world.cells + 1]
    assert start[0] == 0 and start[-1] == COUNT
    for k in range(3):
        h = np.float32(world.layers.specs[k].support) / np.float32([1, 1, Z_CELLS])
        dims = world.grid.dims.to_numpy()[k]
        mine = np.flatnonzero(sorted_layer == k)
        cell = np.clip(np.floor(sorted_x[mine] / h).astype(int), 0, dims - 1)
        across, up, along = cell.T
        index = np.ravel_multi_index((up, across, along), dims[[1, 0, 2]])
        index += world.grid.offset.to_numpy()[k]
        assert np.all(start[index] <= mine) and np.all(mine < start[index + 1])


def assert_equals_brute_force(world, form):
    """Asserts that the list of a form equals the distances of all pairs, up to rounding."""
    neighbours = world.list_of(form)
    neighbours.find()
    x = world.particles.numpy("x").astype(np.float64)
    h = np.array([s.support for s in world.layers.specs])[world.particles.numpy("layer")]
    reach = reaches(form, h)
    distance = np.linalg.norm(x[:, None] - x[None, :], axis=2) - neighbours.margin
    start, end = neighbours.start.to_numpy(), neighbours.end.to_numpy()
    index = neighbours.index.to_numpy()
    edge = 1e-6
    for i in range(len(x)):
        found = index[start[i] : end[i]]
        assert len(set(found)) == len(found) and i not in found
        certain = set(np.flatnonzero(distance[i] < reach[i] - edge)) - {i}
        possible = set(np.flatnonzero(distance[i] < reach[i] + edge)) - {i}
        assert certain <= set(found) <= possible


def reaches(form, h):
    """Returns the reaches (n, n) [m] of all pairs of support radii h (n,) [m]."""
    own, other = np.meshgrid(h, h, indexing="ij")
    pair = PAIR_REACH * (0.5 * (own**2.5 + other**2.5)) ** 0.4
    return {"scatter": other, "pair": pair, "widest": np.maximum(own, other)}[form]


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("seed", range(2))
def test_neighbour_lists_equal_brute_force(world, seed, form):
    world.place(*cloud(seed))
    assert_equals_brute_force(world, form)


def test_crowded_particles_use_list_entries_left_by_others(world):
    """The list is complete where 150 particles lie at one point, although some have more than 1.5
    times the bound of the mean number of neighbours."""
    x, layer = cloud(0)
    x[200:350], layer[200:350] = x[500], layer[500]
    world.place(x, layer)
    assert_equals_brute_force(world, "scatter")
    start, end = (f.to_numpy()[:COUNT] for f in (world.neighbours.start, world.neighbours.end))
    assert (end - start).max() > 1.5 * world.usual


@pytest.mark.parametrize("form", FORMS)
def test_mean_of_neighbours_is_bounded_in_all_mixtures(form):
    """The mean number of neighbours of any mixture of layers, by the integral over all pairs, is at
    most max_mean_neighbours(), and the worst mixture has more than 90 % of it."""
    specs = [LayerSpec(m, 1000.0, 2.45) for m in (1.0, 4.0, 64.0)]
    h, volume = (np.array([getattr(s, name) for s in specs]) for name in ("support", "volume"))
    balls = 4.0 / 3.0 * np.pi * reaches(form, h) ** 3
    shares = np.random.default_rng(0).dirichlet([0.3] * 3, 20_000)
    number = shares / volume
    means = np.einsum("ka,ab,kb->k", number, balls, number) / number.sum(axis=1)
    bound = max_mean_neighbours(specs, 0.0, form)
    assert 0.9 * bound < means.max() <= bound * (1.0 + 1e-6)


def test_a_full_list_raises_an_error_about_collapsed_water(world):
    x = np.full((COUNT, 3), 0.3, dtype=np.float32)
    world.place(x, np.full(COUNT, 2, dtype=np.int32))
    neighbours = world.list_of("scatter")
    with pytest.raises(NeighbourOverflowError, match="collapsed"):
        neighbours.find()
    assert neighbours.end.to_numpy().max() <= neighbours.entries


def test_list_is_stale_after_a_motion_of_half_its_margin(world):
    world.place(*cloud(0))
    neighbours = world.list_of("scatter")
    neighbours.find()
    neighbours.moved(0.49 * neighbours.margin)
    assert not neighbours.stale
    neighbours.moved(0.02 * neighbours.margin)
    assert neighbours.stale


def test_more_particles_than_the_capacity_are_an_error(world):
    with pytest.raises(ValueError, match="exceed the capacity"):
        world.particles.fill(x=np.zeros((COUNT + 51, 3), np.float32))
