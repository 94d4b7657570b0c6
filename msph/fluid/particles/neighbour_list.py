"""The neighbour list: all pairs of particles within reach of each other, over all layers.

Pairs are searched up to a margin beyond their reach (Verlet 1967). The list holds until a particle
has moved by half the margin, so that many short steps of an explicit method share one search.
"""

import math

import numpy as np
import taichi as ti

from msph.errors import BlowUpError
from msph.fluid.constants import Constants
from msph.fluid.particles.grid import LayeredGrid
from msph.fluid.particles.layers import LayerSpec, pair_support
from msph.fluid.particles.mirror_images import INDEX_MASK, MirrorImages
from msph.fluid.particles.particles import Particles
from msph.fluid.room import Room
from msph.taichi_internals import data_oriented, kernel, on_cpu

# Largest distance [m] of neighbours by the list's form, from their supports h_i and h_j [m].
LIST_FORMS = {
    "scatter": lambda h_i, h_j: h_i * 0.0 + h_j,
    "pair": pair_support,
    "widest": np.maximum,
}
# On a CPU, particles found by one thread in turn, which share the room that it takes from the pool.
# On a GPU each particle has a thread and room of its own.
PARTICLES_PER_THREAD = 64
# Particles with the usual number of neighbours for which a thread takes room: RESERVE of those left
# to search (-), so that little stays free after the last, but for MIN_RESERVE particles at least.
RESERVE, MIN_RESERVE = 0.8, 0.75
# Entries of the pool over max_mean_neighbours() (-): a cubic lattice's at a reach of 2.45 spacings, the
# most, are 1.3. Threads leave 2 to 9 % of what they take free.
POOL_FACTOR = 1.4
# Entries that the smallest pool has: 362 particles in one point fill it.
MIN_ENTRIES = 1 << 17
# Room of a particle on a GPU, over the neighbours of the densest layer at rest (-): a cubic lattice
# has 1.3, whose images ask for as much again. Beyond the mass ratio MAX_MASS_RATIO (-) only layers next
# to each other count: those between keep the others apart but in splashes, where they are few.
GPU_FACTOR, MAX_MASS_RATIO = 2.8, 16.5


class NeighbourOverflowError(BlowUpError):
    """The list is full: the fluid has collapsed to many times its density."""


# State of a search for particle i at x [m], after which its thread has `left` to search. Its
# entries are those from `first` to `place`, of which the first `inner` are no images; the thread
# has room up to `limit`.
Search = ti.types.struct(
    i=ti.i32,
    left=ti.i32,
    first=ti.i32,
    place=ti.i32,
    inner=ti.i32,
    limit=ti.i32,
    x=ti.math.vec3,
    reach=ti.f32,
)


@data_oriented
class NeighbourList:
    """Neighbours of particle i: index[start[i]] to index[end[i] - 1], i itself left out.

    j is listed while r_ij < reach + margin, reach by its form: "scatter" h_j, "pair" their
    symmetric support, "widest" max(h_i, h_j). start, end (room,) i32, index (entries,) i32: a pool
    of entries, where each particle's are contiguous, in the order of the grid; on a CPU those of
    different particles lie as threads took room. Kernels vanish at h, so that readers of the list
    need not test the distance. Where walls are mirrors, the entries from mirrors[i] on are mirror
    images, i's own among them; see MirrorImages.read. searches counts the searches made.
    """

    def __init__(
        self,
        room: Room,
        constants: Constants,
        grid: LayeredGrid,
        particles: Particles,
        images: MirrorImages,
    ):
        self.constants, self.grid, self.particles, self.images = constants, grid, particles, images
        self.reaches, self.max_reach = grid.layers.list_reach, grid.layers.max_reach
        self.pooled = on_cpu()
        self.per_thread = PARTICLES_PER_THREAD if self.pooled else 1
        self.start = ti.field(ti.i32, shape=room.particles)
        self.end = ti.field(ti.i32, shape=room.particles)
        self.mirrors = ti.field(ti.i32, shape=room.particles)
        self.index = ti.field(ti.i32, shape=room.entries)
        self.reserved = ti.field(ti.i32, shape=())  # entries of the pool that threads have room in
        self.searches = 0
        self.load(0, 0.0, True)

    def load(self, entries: int, margin: float, mirrored: bool) -> None:
        """Prepares the list for a scene: largest number of entries, margin [m], and whether walls
        are mirrors. Raises ValueError for more particles than an entry can name."""
        if self.particles.capacity > INDEX_MASK:
            most, asked = f"{INDEX_MASK:,}", f"{self.particles.capacity:,}"
            raise ValueError(f"a list can name {most} particles, not {asked}")
        self.entries, self.margin, self.mirrored = entries, margin, mirrored
        self.slack = 0.0
        self.generation = -1

    def refresh(self) -> None:
        """Searches anew if particles were reordered or may have moved by half the margin."""
        if self.stale:
            self.grid.refresh()
            self.find()

    def find(self) -> None:
        """Searches anew in a fresh grid. Raises NeighbourOverflowError if the list is full."""
        if self._find(self.particles.count, self.mirrored) > self.entries:
            raise NeighbourOverflowError(
                f"the neighbours of {self.particles.count:,} particles do not fit in a list of "
                f"{self.entries:,}: the water has collapsed"
            )
        self.slack = self.margin
        self.generation = self.grid.generation
        self.searches += 1

    def moved(self, distance: float) -> None:
        """Tells the list that no particle has moved farther than `distance` [m] just now."""
        self.slack -= 2.0 * distance

    @property
    def stale(self) -> bool:
        return self.slack < 0.0 or self.generation != self.grid.generation

    @ti.func
    def span(self, i, mirrored: ti.template()):
        """Entries [begin, end) of particle i: its neighbours, or with `mirrored` mirror images."""
        begin, end = self.start[i], self.mirrors[i]
        if ti.static(mirrored):
            begin, end = self.mirrors[i], self.end[i]
        return begin, end

    @ti.func
    def read(self, s, mirrored: ti.template()):
        """Particle j of an entry of span(), and the mirror and wall it is seen in: a vector v as
        mirror * v, its place by offset(). Without `mirrored` the compiler drops both."""
        j, mirror, wall = self.index[s], ti.Vector([1.0, 1.0, 1.0]), ti.Vector([0.0, 0.0, 0.0])
        if ti.static(mirrored):
            j, mirror, wall = self.images.read(self.index[s])
        return j, mirror, wall

    @kernel
    def _find(self, n: ti.i32, mirrored: ti.template()) -> ti.i32:
        """Returns the entries that threads took room for, or asked for where the pool is full."""
        self.reserved[None] = 0
        # Over particles, not over stretches: the CPU runtime keeps loops under 512 on one thread.
        for begin in range(n):
            if begin % self.per_thread == 0:
                end = ti.min(begin + self.per_thread, n)
                search = Search(place=0, limit=0)
                if ti.static(not self.pooled):
                    own = self.constants.entries_per_particle[None]
                    search.place, search.limit = begin * own, (begin + 1) * own
                for i in range(begin, end):
                    search.i, search.left, search.x = i, end - i - 1, self.particles.x[i]
                    search.first = search.place
                    for layer in range(self.constants.layers[None]):
                        search.reach = self.reaches[self.particles.layer[i], layer]
                        self.grid.for_each_row(search.x, layer, search.reach, self._add_row, search)
                    self._remove_self(search)
                    search.inner = search.place - search.first
                    if ti.static(mirrored):
                        self._add_images(search)
                        self.mirrors[i] = search.first + search.inner
                    self.start[i], self.end[i] = search.first, search.place
        return self.reserved[None]

    @ti.func
    def _make_room(self, count, search: ti.template()):
        """Whether there is room for `count` further entries, reserved from the pool where the thread
        has none."""
        if search.place + count > search.limit:
            if ti.static(self.pooled):
                self._reserve(count, search)
            else:
                self.reserved[None] = self.constants.entries[None] + 1
        return search.place + count <= search.limit

    @ti.func
    def _reserve(self, count, search: ti.template()):
        """Takes room for the particle with `count` further entries and for others after it. Its
        entries so far move there, unless it goes on where the thread's room ends."""
        found = search.place - search.first
        ahead = ti.max(RESERVE * search.left, MIN_RESERVE)
        wanted = found + count + ti.ceil(ahead * self.constants.mean_neighbours[None], ti.i32)
        entries = self.constants.entries[None]
        begin = entries
        if self.reserved[None] <= entries:
            begin = ti.atomic_add(self.reserved[None], wanted)
        if begin + wanted <= entries:
            if begin != search.limit:
                for k in range(found):
                    self.index[begin + k] = self.index[search.first + k]
                search.first, search.place = begin, begin + found
            search.limit = begin + wanted

    @ti.func
    def _add_images(self, search: ti.template()):
        """Adds the mirror images, within reach, of the neighbours found so far and of the particle,
        without branches as _add_row()."""
        i, x, inner = search.i, search.x, search.inner
        layer = self.particles.layer[i]
        near = self.images.walls_near(x, self.max_reach[layer])
        for way in range(1, self.images.combinations(near)):
            if self._make_room(inner + 1, search):
                mirrors = self.images.combination(way, near)
                mirror, wall = self.images.mirror_and_wall(mirrors)
                first, place = search.first, search.place
                own = self.images.offset(x, x, mirror, wall).norm_sqr()
                self.index[place] = self.images.entry(i, mirrors)
                place += ti.select(own < self.reaches[layer, layer] ** 2, 1, 0)
                for s in range(first, first + inner):
                    j = self.index[s]
                    reach = self.reaches[layer, self.particles.layer[j]]
                    r_ij = self.images.offset(x, self.particles.x[j], mirror, wall)
                    self.index[place] = self.images.entry(j, mirrors)
                    place += ti.select(r_ij.norm_sqr() < reach * reach, 1, 0)
                search.place = place

    @ti.func
    def _remove_self(self, search: ti.template()):
        """Puts the last entry in the place of particle i's own: to ask of each candidate whether it
        is i would take a quarter of the search."""
        own = -1
        for s in range(search.first, search.place):
            own = ti.max(own, ti.select(self.index[s] == search.i, s, -1))
        if own >= 0:
            search.place -= 1
            self.index[own] = self.index[search.place]

    @ti.func
    def _add_row(self, begin, end, search: ti.template()):
        """Adds the particles of a row that are within reach, i too, if the row might fit. Each is
        written to the next place, which advances only if it is within reach: a branch would be
        mispredicted."""
        if self._make_room(end - begin, search):
            place = search.place
            x, reach2 = search.x, search.reach * search.reach
            for j in range(begin, end):
                r2 = (x - self.particles.x[j]).norm_sqr()
                self.index[place] = j
                place += ti.select(r2 < reach2, 1, 0)
            search.place = place


def list_tables(
    specs: list[LayerSpec], margin: float, form: str
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Columns of the list in the tables by layer (max_reach [m]) and by pair of layers (list_reach
    [m]); margin: share (-) of the finest support."""
    supports = np.array([s.support for s in specs])
    reaches = LIST_FORMS[form](supports[:, None], supports) + margin * supports.min()
    return {"max_reach": reaches.max(axis=1)}, {"list_reach": reaches}


def max_mean_neighbours(specs: list[LayerSpec], margin: float, form: str) -> float:
    """The most neighbours (-), images among them, that particles have in the mean at rest.

    Of n_a particles of layer a in a volume, sum n_a V_a = 1, all have sum n_a n_b 4/3 pi r_ab^3.
    Both ends of a pair together, r_ab^3 + r_ba^3, are at most (V_a + V_b) times their largest such
    quotient, so that times sum n_a is the most. That is what one layer alone has for "scatter" and
    "pair", whose mean of supports is below that of their cubes, at most twice as much for "widest".
    """
    supports, volumes = (np.array([getattr(s, k) for s in specs]) for k in ("support", "volume"))
    balls = (LIST_FORMS[form](supports[:, None], supports) + margin * supports.min()) ** 3
    most = ((balls + balls.T) / (volumes[:, None] + volumes)).max()
    return float(4.0 / 3.0 * math.pi * most)


def max_neighbours(specs: list[LayerSpec], margin: float, form: str) -> int:
    """Entries that a particle has room for where each has its own.

    At rest a ball of radius r holds 4/3 pi r^3/V particles. The most neighbours has a coarse
    particle among fine ones; pairs of layers count here if they are next to each other in size, or
    differ by less than MAX_MASS_RATIO in mass.
    """
    order = sorted(specs, key=lambda s: s.volume)
    supports, volumes = (np.array([getattr(s, k) for s in order]) for k in ("support", "volume"))
    reaches = LIST_FORMS[form](supports[:, None], supports) + margin * supports.min()
    rank = np.arange(len(order))
    met = (volumes[:, None] <= MAX_MASS_RATIO * volumes) | (rank[:, None] <= rank + 1)
    most = (reaches**3 / volumes)[met].max()
    return math.ceil(GPU_FACTOR * 4.0 / 3.0 * math.pi * most)


def list_capacity(
    specs: list[LayerSpec], margin: float, form: str, capacity: int, pooled: bool = False
) -> int:
    """Entries of the list for `capacity` particles; pooled: where threads take room from a pool, as
    on a CPU."""
    if not pooled:
        return capacity * max_neighbours(specs, margin, form)
    return max(
        MIN_ENTRIES, math.ceil(POOL_FACTOR * max_mean_neighbours(specs, margin, form) * capacity)
    )
