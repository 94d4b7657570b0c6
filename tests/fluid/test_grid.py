"""Scan, sort, grid and neighbour list against brute force."""

import numpy as np
import pytest
import taichi as ti

from msph.fluid.particles.grid import CUTS, LayeredGrid
from msph.fluid.particles.layers import Layers, LayerSpec
from msph.fluid.particles.neighbour_list import (
    NeighbourList,
    NeighbourOverflowError,
    neighbours_provided,
)
from msph.fluid.particles.particles import Attribute, Particles
from msph.fluid.particles.prefix_sum import CHUNK, PrefixSum

SIZE = (1.0, 0.7, 0.33)
COUNT = 600
TAG = Attribute("tag", "-", "rides along with the sort")


def cloud(seed):
    """Random particles of three layers, with points on every face, edge and corner of the box."""
    rng = np.random.default_rng(seed)
    x = rng.uniform(0.0, 1.0, (COUNT, 3))
    x[:150] = np.round(x[:150])
    x[150:250, seed % 3] = np.round(x[150:250, seed % 3])
    return (x * SIZE).astype(np.float32), rng.integers(0, 3, COUNT).astype(np.int32)


class World:
    """Particles in a grid, with a scatter list and a symmetric one."""

    def __init__(self):
        masses = (1.0, 0.25, 3.0)
        # Supports of about .2, .12 and .3 m, none of which divides the box.
        self.layers = Layers([LayerSpec(m, 1000.0, 2.03) for m in masses])
        self.particles = Particles(COUNT + 50, (TAG,))
        self.grid = LayeredGrid(SIZE, self.layers, self.particles)
        self.lists = {
            "scatter": NeighbourList(self.grid, self.particles, "scatter", 0.3),
            "pair": NeighbourList(self.grid, self.particles, "pair", 0.1),
            "widest": NeighbourList(self.grid, self.particles, "widest", 0.0),
        }

    def place(self, x, layer):
        self.particles.fill(x=x, layer=layer, tag=np.arange(len(x), dtype=np.float32))
        self.grid.build()


@pytest.fixture(scope="module")
def world():
    return World()


@pytest.mark.parametrize("length", [1, CHUNK - 1, CHUNK, CHUNK + 1, 5 * CHUNK + 17])
def test_scan_is_the_cumulative_sum(length):
    counts = np.random.default_rng(length).integers(0, 9, length).astype(np.int32)
    source, target = ti.field(ti.i32, shape=length), ti.field(ti.i32, shape=length + 1)
    source.from_numpy(counts)
    PrefixSum(length).run(source, target)
    assert np.array_equal(target.to_numpy(), np.concatenate([[0], np.cumsum(counts)]))


@pytest.mark.parametrize("seed", range(3))
def test_sort_keeps_every_particle_whole(world, seed):
    x, layer = cloud(seed)
    world.place(x, layer)
    order = world.particles.numpy("id")
    assert sorted(order) == list(range(COUNT))
    assert np.array_equal(world.particles.numpy("x"), x[order])
    assert np.array_equal(world.particles.numpy("layer"), layer[order])
    assert np.array_equal(world.particles.numpy("tag"), order.astype(np.float32))
    assert np.all(np.diff(world.particles.numpy("layer")) >= 0)


@pytest.mark.parametrize("seed", range(3))
def test_cells_hold_what_lies_in_them(world, seed):
    x, layer = cloud(seed)
    world.place(x, layer)
    start = world.grid.cell_start.to_numpy()
    assert start[0] == 0 and start[-1] == COUNT
    sorted_x, sorted_layer = world.particles.numpy("x"), world.particles.numpy("layer")
    for k in range(3):
        h = np.float32(world.layers.specs[k].support) / np.float32([1, 1, CUTS])
        dims = world.grid.dims.to_numpy()[k]
        mine = np.flatnonzero(sorted_layer == k)
        cell = np.clip(np.floor(sorted_x[mine] / h).astype(int), 0, dims - 1)
        across, up, along = cell.T
        index = np.ravel_multi_index((up, across, along), dims[[1, 0, 2]])
        index += world.grid.offset.to_numpy()[k]
        assert np.all(start[index] <= mine) and np.all(mine < start[index + 1])


@pytest.mark.parametrize("form", ["scatter", "pair", "widest"])
@pytest.mark.parametrize("seed", range(3))
def test_neighbour_lists_equal_brute_force(world, seed, form):
    world.place(*cloud(seed))
    neighbours = world.lists[form]
    neighbours.find()
    x = world.particles.numpy("x").astype(np.float64)
    h = np.array([s.support for s in world.layers.specs])[world.particles.numpy("layer")]
    own, other = np.meshgrid(h, h, indexing="ij")
    pair = (0.5 * (own**2.5 + other**2.5)) ** 0.4
    forms = {"scatter": other, "pair": pair, "widest": np.maximum(own, other)}
    reach = forms[form]
    distance = np.linalg.norm(x[:, None] - x[None, :], axis=2) - neighbours.margin
    start, end = neighbours.start.to_numpy(), neighbours.end.to_numpy()
    index = neighbours.index.to_numpy()
    edge = 1e-6
    for i in range(COUNT):
        found = index[start[i] : end[i]]
        assert len(set(found)) == len(found) and i not in found
        certain = set(np.flatnonzero(distance[i] < reach[i] - edge)) - {i}
        possible = set(np.flatnonzero(distance[i] < reach[i] + edge)) - {i}
        assert certain <= set(found) <= possible


def test_lists_provide_for_layers_that_meet():
    """A coarse particle among many times finer ones, unless layers between part them."""

    def provided(*masses):
        return neighbours_provided([LayerSpec(m, 1000.0, 2.45) for m in masses], 0.0, "pair")

    reach = 2.45 * (0.5 * (4.0**2.5 + 1.0)) ** 0.4
    assert provided(64.0, 1.0) > 4.0 / 3.0 * np.pi * reach**3
    doubling = [2.0**k for k in range(10)]
    assert provided(*doubling) == provided(*doubling[:5])


def test_full_list_says_that_the_water_collapsed(world):
    x = np.full((COUNT, 3), 0.3, dtype=np.float32)
    world.place(x, np.full(COUNT, 2, dtype=np.int32))
    with pytest.raises(NeighbourOverflowError, match="collapsed"):
        world.lists["scatter"].find()


def test_list_is_stale_once_something_moved_half_its_margin(world):
    world.place(*cloud(0))
    neighbours = world.lists["scatter"]
    neighbours.find()
    neighbours.moved(0.49 * neighbours.margin)
    assert not neighbours.stale
    neighbours.moved(0.02 * neighbours.margin)
    assert neighbours.stale


def test_pool_refuses_more_particles_than_it_holds(world):
    with pytest.raises(ValueError, match="do not fit"):
        world.particles.fill(x=np.zeros((COUNT + 51, 3), np.float32))
