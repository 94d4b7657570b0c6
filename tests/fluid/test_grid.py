"""Scan, sort, grid and neighbour list against brute force."""

from types import SimpleNamespace

import numpy as np
import pytest
import taichi as ti

from msph.fluid.particles import particles
from msph.fluid.particles.grid import CUTS, LayeredGrid
from msph.fluid.particles.layers import Layers, LayerSpec
from msph.fluid.particles.mirror_images import MirrorImages
from msph.fluid.particles.neighbour_list import (
    NeighbourList,
    NeighbourOverflowError,
    mean_neighbours,
)
from msph.fluid.particles.particles import Attribute, Particles
from msph.fluid.particles.prefix_sum import CHUNK, PrefixSum

FORMS = ["scatter", "pair", "widest"]
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


class Shared(Particles):
    """Threads share loops over them, few as they are."""

    alone = False


class World:
    """Particles in a grid, with a scatter list and a symmetric one."""

    def __init__(self):
        masses = (1.0, 0.25, 3.0)
        # Supports of about .2, .12 and .3 m, none of which divides the box.
        self.layers = Layers([LayerSpec(m, 1000.0, 2.03) for m in masses])
        self.particles = Shared(COUNT + 50, (TAG,))
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


@pytest.mark.parametrize("few", [True, False])
@pytest.mark.parametrize("length", [1, CHUNK - 1, CHUNK, CHUNK + 1, 5 * CHUNK + 17])
def test_scan_is_the_cumulative_sum(length, few):
    """On one thread, and in chunks that threads share."""
    counts = np.random.default_rng(length).integers(0, 9, length).astype(np.int32)
    source, target = ti.field(ti.i32, shape=length), ti.field(ti.i32, shape=length + 1)
    source.from_numpy(counts)
    scan = PrefixSum(length)
    scan.few = few
    scan.run(source, target)
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


def assert_equals_brute_force(world, form):
    """Finds the list of this form and compares it with the distances of all pairs."""
    neighbours = world.lists[form]
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
    """Reaches (n, n) [m] of all pairs of supports h (n,) [m]."""
    own, other = np.meshgrid(h, h, indexing="ij")
    pair = (0.5 * (own**2.5 + other**2.5)) ** 0.4
    return {"scatter": other, "pair": pair, "widest": np.maximum(own, other)}[form]


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("seed", range(3))
def test_neighbour_lists_equal_brute_force(world, seed, form):
    world.place(*cloud(seed))
    assert_equals_brute_force(world, form)


def test_crowd_in_one_point_takes_room_that_others_leave(world):
    """Each of the crowd has more than half as many again as the usual neighbours."""
    if not world.lists["scatter"].pooled:
        pytest.skip("on a GPU each particle has room of its own")
    x, layer = cloud(0)
    x[200:350], layer[200:350] = x[500], layer[500]
    world.place(x, layer)
    assert_equals_brute_force(world, "scatter")
    neighbours = world.lists["scatter"]
    most = (neighbours.end.to_numpy() - neighbours.start.to_numpy()).max()
    assert most > 1.5 * neighbours.usual


@pytest.mark.parametrize("form", FORMS)
def test_mean_of_neighbours_is_bounded_in_all_mixtures(form):
    """By the integral over all pairs of a mixture of layers, which the worst one nearly attains."""
    specs = [LayerSpec(m, 1000.0, 2.45) for m in (1.0, 4.0, 64.0)]
    h, volume = (np.array([getattr(s, name) for s in specs]) for name in ("support", "volume"))
    balls = 4.0 / 3.0 * np.pi * reaches(form, h) ** 3
    shares = np.random.default_rng(0).dirichlet([0.3] * 3, 20_000)
    number = shares / volume
    means = np.einsum("ka,ab,kb->k", number, balls, number) / number.sum(axis=1)
    bound = mean_neighbours(specs, 0.0, form)
    assert 0.9 * bound < means.max() <= bound * (1.0 + 1e-6)


def test_cubic_lattice_between_walls_fits():
    """Most of its particles have images, for which threads take room that stays free."""
    along = 12
    spec = LayerSpec(1.0, 1000.0, 2.45)
    size = (0.1 * along,) * 3
    particles = Particles(along**3, ())
    grid = LayeredGrid(size, Layers([spec]), particles)
    neighbours = NeighbourList(grid, particles, "pair", 0.0, MirrorImages(size))
    corner = np.stack(np.meshgrid(*[np.arange(along)] * 3), axis=-1).reshape(-1, 3)
    particles.fill(x=(0.1 * (corner + 0.5)).astype(np.float32), layer=np.zeros(along**3, np.int32))
    grid.build()
    neighbours.find()
    steps = np.stack(np.meshgrid(*[np.arange(-3, 4)] * 3), axis=-1).reshape(-1, 3)
    near = np.sum(np.linalg.norm(steps, axis=1) < 2.45) - 1
    start, end = (f.to_numpy() for f in (neighbours.start, neighbours.end))
    assert np.all(end - start == near)


def test_full_list_says_that_the_water_collapsed(world):
    x = np.full((COUNT, 3), 0.3, dtype=np.float32)
    world.place(x, np.full(COUNT, 2, dtype=np.int32))
    neighbours = world.lists["scatter"]
    with pytest.raises(NeighbourOverflowError, match="collapsed"):
        neighbours.find()
    assert neighbours.end.to_numpy().max() <= neighbours.index.shape[0]


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


@pytest.mark.parametrize(("threads", "most"), [(1, 10**6), (2, 1300), (4, 866), (16, 693)])
def test_few_entries_stay_on_one_thread(monkeypatch, threads, most):
    """The more threads share a loop, the fewer entries pay for waking them."""
    monkeypatch.setattr(particles, "on_cpu", lambda: True)
    cfg = SimpleNamespace(cpu_max_num_threads=threads)
    monkeypatch.setattr(particles, "ti", SimpleNamespace(cfg=cfg))
    assert particles.one_thread_does(most)
    assert threads == 1 or not particles.one_thread_does(most + 1)


def test_a_run_does_not_go_to_and_fro_between_threads(monkeypatch):
    monkeypatch.setattr(particles, "on_cpu", lambda: True)
    pool = Particles(4000)
    monkeypatch.setattr(
        particles, "ti", SimpleNamespace(cfg=SimpleNamespace(cpu_max_num_threads=2))
    )
    found = []
    for count in (1200, 1400, 1900, 2000, 1400, 900, 860):
        pool.count = count
        found.append(pool.alone)
    assert found == [True, True, True, False, False, False, True]
