"""Neighbour list: all pairs of particles within reach of each other, over all layers.

Pairs are searched up to a margin beyond their reach (Verlet 1967). The list stays valid until a
particle has moved by half the margin, so that short steps of an explicit method share a search.
"""

import math

import numpy as np
import taichi as ti

from msph.errors import BlowUpError
from msph.fluid.particles.grid import LayeredGrid
from msph.fluid.particles.layers import LayerSpec, pair_support
from msph.fluid.room import Room
from msph.launches import data_oriented, heavy_kernel
from msph.taichi_internals import on_cpu

# Share (-) of the symmetric support within which pairs are listed: beyond it the quartic kernel is
# below 2e-5 of its peak. Pairs are 14 % fewer. Pressures of still water are as accurate as with 1;
# with 0.93 they are not (docs/trials.md).
PAIR_REACH = 0.95
# Support [m] of the kernel of two particles with supports h_i and h_j [m], by form of the list.
LIST_FORMS = {
    "scatter": lambda h_i, h_j: h_i * 0.0 + h_j,
    "pair": pair_support,
    "widest": np.maximum,
}
# Particles that one CPU thread searches for in a row, with one reservation of the pool of entries.
# A GPU has one thread per particle, which counts its entries before it reserves them.
PARTICLES_PER_THREAD = 64
# Share (-) of a thread's remaining particles, with the mean number of neighbours, for which it
# reserves entries; at least for MIN_RESERVE particles. Threads leave 2 to 9 % of them unused.
RESERVE, MIN_RESERVE = 0.8, 0.75
# Entries of the pool over max_mean_neighbours() (-): a cubic lattice with a reach of 2.45 spacings
# needs the most, 1.3.
POOL_FACTOR = 1.4
# Least number of entries: 362 particles at one point fill them.
MIN_ENTRIES = 1 << 17


class NeighbourOverflowError(BlowUpError):
    """The list is full: the fluid has collapsed to many times its density."""


# Search for the neighbours of particle i at x [m]; its thread has `left` more particles to search.
# Its entries are `first` to `place`, reserved up to `limit`. A GPU counts them first: `count`.
Search = ti.types.struct(
    i=ti.i32,
    left=ti.i32,
    count=ti.i32,
    first=ti.i32,
    place=ti.i32,
    limit=ti.i32,
    x=ti.math.vec3,
    reach=ti.f32,
)


@data_oriented
class NeighbourList:
    """Neighbours of particle i without i itself: index[start[i]] to index[end[i] - 1].

    j is listed if r_ij < reach + margin; reach by form: "scatter" h_j, "pair" PAIR_REACH times the
    symmetric support, "widest" max(h_i, h_j). Kernels vanish at h, so readers need not test the
    distance.
    start, end (particles,) i32; index (entries,) i32 is a pool in which a particle's entries are
    contiguous, in grid order; the order of particles is arbitrary. searches counts the searches.
    """

    def __init__(self, room: Room, grid: LayeredGrid):
        self.constants, self.grid, self.particles = grid.constants, grid, grid.particles
        self.reaches, self.max_reach = grid.layers.list_reach, grid.layers.max_reach
        self.counted = not on_cpu()
        self.per_thread = 1 if self.counted else PARTICLES_PER_THREAD
        self.start, self.end = (ti.field(ti.i32, room.particles) for _ in range(2))
        self.index = ti.field(ti.i32, shape=room.entries)
        self.reserved = ti.field(ti.i32, shape=())  # entries of the pool that threads have reserved
        self.searches = 0
        self.load(0, 0.0)

    def load(self, entries: int, margin: float) -> None:
        """Sets the largest number of entries and the margin [m]."""
        self.entries, self.margin = entries, margin
        self.slack = 0.0
        self.generation = -1

    def refresh(self) -> None:
        """Searches if particles were reordered or may have moved by half the margin."""
        if self.stale:
            self.grid.refresh()
            self.find()

    def find(self) -> None:
        """Searches in a fresh grid. Raises NeighbourOverflowError if the list is full."""
        if self._find(self.particles.count) > self.entries:
            raise NeighbourOverflowError(
                f"the neighbours of {self.particles.count:,} particles do not fit in a list of "
                f"{self.entries:,}: the water has collapsed"
            )
        self.slack = self.margin
        self.generation = self.grid.generation
        self.searches += 1

    def moved(self, distance: float) -> None:
        """Records that particles have moved by at most `distance` [m]."""
        self.slack -= 2.0 * distance

    @property
    def stale(self) -> bool:
        return self.slack < 0.0 or self.generation != self.grid.generation

    @heavy_kernel
    def _find(self, n: ti.i32) -> ti.i32:
        """Returns the number of reserved entries, more than `entries` if the pool is full."""
        self.reserved[None] = 0
        # One iteration per particle: the CPU runtime runs loops below 512 iterations on one thread.
        for begin in range(n):
            if begin % self.per_thread == 0:
                end = ti.min(begin + self.per_thread, n)
                search = Search(place=0, limit=0)
                for i in range(begin, end):
                    search.i, search.left, search.x = i, end - i - 1, self.particles.x[i]
                    if ti.static(self.counted):
                        self._reserve_counted(search)
                    search.first = search.place
                    self._visit_rows(self._add_row, search)
                    self._remove_self(search)
                    self.start[i], self.end[i] = search.first, search.place
        return self.reserved[None]

    @ti.func
    def _visit_rows(self, visit: ti.template(), search: ti.template()):
        """Calls visit(begin, end, search) for ranges that contain all particles within reach."""
        layer = self.particles.layer[search.i]
        for other in range(self.constants.layers[None]):
            search.reach = self.reaches[layer, other]
            self.grid.for_each_row(search.x, other, search.reach, visit, search)

    @ti.func
    def _make_room(self, count, search: ti.template()):
        """Returns whether there is room for `count` more entries, if necessary by a reservation.
        Counted entries have room unless the pool is full."""
        room = search.limit > 0
        if ti.static(not self.counted):
            if search.place + count > search.limit:
                self._reserve(count, search)
            room = search.place + count <= search.limit
        return room

    @ti.func
    def _advance(self, listed, place, search: ti.template()):
        """Returns 1 if an entry is listed, otherwise 0. Counting and listing may round differently:
        the last counted entry stays free."""
        if ti.static(self.counted):
            listed = listed and place + 1 < search.limit
        return ti.select(listed, 1, 0)

    @ti.func
    def _reserve_counted(self, search: ti.template()):
        """Reserves the entries of a particle, itself included, and a last one that stays free."""
        search.count = 1
        self._visit_rows(self._count_row, search)
        begin = ti.atomic_add(self.reserved[None], search.count)
        if begin + search.count <= self.constants.entries[None]:
            search.place, search.limit = begin, begin + search.count

    @ti.func
    def _count_row(self, begin, end, search: ti.template()):
        """Counts the particles of a row within reach, including i."""
        x, reach2, count = search.x, search.reach**2, 0
        for j in range(begin, end):
            count += ti.select((x - self.particles.x[j]).norm_sqr() < reach2, 1, 0)
        search.count += count

    @ti.func
    def _reserve(self, count, search: ti.template()):
        """Reserves entries for this particle with `count` more, and for later ones. Moves the
        particle's entries unless the reservation continues the previous one."""
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
    def _remove_self(self, search: ti.template()):
        """Removes i itself: excluding i in _add_row() would take a quarter of the search."""
        own = -1
        for s in range(search.first, search.place):
            own = ti.max(own, ti.select(self.index[s] == search.i, s, -1))
        if own >= 0:
            search.place -= 1
            self.index[own] = self.index[search.place]

    @ti.func
    def _add_row(self, begin, end, search: ti.template()):
        """Adds the particles of a row within reach, including i. Each is written to the next place,
        which advances only if the particle is within reach: a branch would be mispredicted."""
        if self._make_room(end - begin, search):
            place = search.place
            x, reach2 = search.x, search.reach * search.reach
            for j in range(begin, end):
                r2 = (x - self.particles.x[j]).norm_sqr()
                self.index[place] = j
                place += self._advance(r2 < reach2, place, search)
            search.place = place


def list_reaches(specs: list[LayerSpec], margin: float, form: str) -> np.ndarray:
    """Returns the list's reach (layers, layers) [m]; margin: share (-) of the finest support."""
    supports, share = np.array([s.support for s in specs]), PAIR_REACH if form == "pair" else 1.0
    return share * LIST_FORMS[form](supports[:, None], supports) + margin * supports.min()


def list_tables(
    specs: list[LayerSpec], margin: float, form: str
) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Returns the columns by layer (max_reach [m]) and by pair of layers (list_reach [m])."""
    reaches = list_reaches(specs, margin, form)
    return {"max_reach": reaches.max(axis=1)}, {"list_reach": reaches}


def max_mean_neighbours(specs: list[LayerSpec], margin: float, form: str) -> float:
    """Returns an upper bound of the mean number of neighbours (-) at rest, images included.

    With n_a particles of layer a in a volume, sum n_a V_a = 1, there are sum n_a n_b 4/3 pi r_ab^3
    neighbours. r_ab^3 + r_ba^3 is at most (V_a + V_b) times its largest such quotient, which times
    sum n_a is the bound. For "scatter" and "pair" it is the value of a single layer, for "widest"
    at most twice that.
    """
    volumes = np.array([s.volume for s in specs])
    balls = list_reaches(specs, margin, form) ** 3
    most = ((balls + balls.T) / (volumes[:, None] + volumes)).max()
    return float(4.0 / 3.0 * math.pi * most)


def list_capacity(specs: list[LayerSpec], margin: float, form: str, capacity: int) -> int:
    """Returns the number of entries for `capacity` particles."""
    return max(
        MIN_ENTRIES, math.ceil(POOL_FACTOR * max_mean_neighbours(specs, margin, form) * capacity)
    )
