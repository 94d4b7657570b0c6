"""The neighbour list: all pairs of particles within reach of each other, over all layers.

Pairs are searched up to a margin beyond their reach (Verlet 1967). The list holds until a particle
has moved by half the margin, so that many short steps of an explicit method share one search.
"""

import math

import numpy as np
import taichi as ti

from msph.constant_fields import constant_fields
from msph.errors import BlowUpError
from msph.fluid.particles.grid import LayeredGrid
from msph.fluid.particles.layers import LayerSpec, pair_support
from msph.fluid.particles.mirror_images import INDEX_MASK, MirrorImages
from msph.fluid.particles.particles import Particles
from msph.taichi_internals import data_oriented, kernel, on_cpu

# Largest distance [m] of neighbours by the list's form, from their supports h_i and h_j [m].
REACHES = {"scatter": lambda h_i, h_j: h_i * 0.0 + h_j, "pair": pair_support, "widest": np.maximum}
# Length of the list over the neighbours at rest (-): compressed water and mixed sizes have more.
ROOM = 2.0
# Mass ratio (-) beyond which no room is provided for a coarse particle among fine ones, unless
# their layers are next to each other: layers between keep them apart but in splashes, where they
# are few; the first where a stretch is shared, so that they may use what others leave.
MUCH_FINER_SHARED, MUCH_FINER = 2.5, 16.5
# Particles that share one stretch of the list, found by one thread in turn: room that one leaves
# free serves the next. On a GPU each particle has its own stretch and thread.
SHARERS_CPU, SHARERS_GPU = 32, 1


class NeighbourOverflowError(BlowUpError):
    """The list is full: the fluid has collapsed to many times its density."""


# State of a search for particle i at x [m]: entries are written at `place`, below `limit`; wanted
# counts the entries that the stretch would need.
Search = ti.types.struct(
    i=ti.i32, place=ti.i32, limit=ti.i32, wanted=ti.i32, x=ti.math.vec3, reach=ti.f32
)


@data_oriented
class NeighbourList:
    """Neighbours of particle i: index[start[i]] to index[end[i] - 1], i itself left out.

    j is listed while r_ij < reach + margin, reach by its form: "scatter" h_j, "pair" their
    symmetric support, "widest" max(h_i, h_j). margin is a share (-) of the finest support. start,
    end (capacity,) i32, index (room,) i32. Kernels vanish at h, so that readers of the list need
    not test the distance. With `images` the entries from mirrors[i] on are mirror images, i's own
    among them; see MirrorImages.read. searches counts the searches made.
    """

    def __init__(
        self,
        grid: LayeredGrid,
        particles: Particles,
        reach: str,
        margin: float,
        images: MirrorImages | None = None,
    ):
        if particles.capacity > INDEX_MASK:
            raise ValueError(
                f"a list can name {INDEX_MASK:,} particles, not {particles.capacity:,}"
            )
        self.grid = grid
        self.images, self.mirrored = images, images is not None
        self.particles = particles
        self.margin = margin * grid.layers.finest.support
        supports = np.array([s.support for s in grid.layers.specs])
        reaches = REACHES[reach](supports[:, None], supports) + self.margin
        self.reaches, self.farthest = constant_fields(reaches, reaches.max(axis=1))
        self.sharers = SHARERS_CPU if on_cpu() else SHARERS_GPU
        specs = grid.layers.specs
        self.stretch = self.sharers * neighbours_provided(specs, margin, reach, self.sharers > 1)
        stretches = math.ceil(particles.capacity / self.sharers)
        self.start = ti.field(ti.i32, shape=particles.capacity)
        self.end = ti.field(ti.i32, shape=particles.capacity)
        self.mirrors = ti.field(ti.i32, shape=particles.capacity) if images else self.end
        self.index = ti.field(ti.i32, shape=stretches * self.stretch)
        self.slack = 0.0
        self.generation = -1
        self.searches = 0

    def refresh(self) -> None:
        """Searches anew if particles were reordered or may have moved by half the margin."""
        if self.stale:
            self.grid.refresh()
            self.find()

    def find(self) -> None:
        """Searches anew in a fresh grid. Raises NeighbourOverflowError if the list is full."""
        wanted = self._find(self.particles.count, self.particles.alone)
        if wanted > self.stretch:
            raise NeighbourOverflowError(
                f"{wanted} neighbours of {self.sharers} particles do not fit in a list of "
                f"{self.stretch}: the water has collapsed"
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
    def _find(self, n: ti.i32, alone: ti.template()) -> ti.i32:
        """Returns the most entries that a stretch needs."""
        fullest = 0
        # Over particles, not over stretches: the CPU runtime keeps loops under 512 on one thread.
        ti.loop_config(serialize=alone)
        for first in range(n):
            if first % self.sharers == 0:
                place = first // self.sharers * self.stretch
                search = Search(place=place, limit=place + self.stretch, wanted=1)
                for i in range(first, ti.min(first + self.sharers, n)):
                    search.i = i
                    search.x = self.particles.x[i]
                    self.start[i] = search.place
                    for layer in range(self.grid.layers.count):
                        search.reach = self.reaches[self.particles.layer[i], layer]
                        self.grid.for_each_row(search.x, layer, search.reach, self._add_row, search)
                    self._leave_out_self(search)
                    if ti.static(self.mirrored):
                        self.mirrors[i] = search.place
                        self._add_images(search)
                    self.end[i] = search.place
                ti.atomic_max(fullest, search.wanted)
        return fullest

    @ti.func
    def _add_images(self, search: ti.template()):
        """Adds the mirror images, within reach, of the neighbours found so far and of the particle.

        Written as in _add_row(): without branches, and only counted where they might not fit.
        """
        i, x, first, last = search.i, search.x, self.start[search.i], search.place
        layer = self.particles.layer[i]
        near = self.images.near(x, self.farthest[layer])
        for way in range(1, self.images.combinations(near)):
            mirrors = self.images.combination(way, near)
            mirror, wall = self.images.seen_in(mirrors)
            place = search.place
            fits = place + last - first + 1 < search.limit
            own = self.images.offset(x, x, mirror, wall).norm_sqr()
            if fits:
                self.index[place] = self.images.entry(i, mirrors)
                place += ti.select(own < self.reaches[layer, layer] ** 2, 1, 0)
            for s in range(first, ti.select(fits, last, first)):
                j = self.index[s]
                reach = self.reaches[layer, self.particles.layer[j]]
                r_ij = self.images.offset(x, self.particles.x[j], mirror, wall)
                self.index[place] = self.images.entry(j, mirrors)
                place += ti.select(r_ij.norm_sqr() < reach * reach, 1, 0)
            search.wanted += ti.select(fits, place - search.place, last - first + 1)
            search.place = place

    @ti.func
    def _leave_out_self(self, search: ti.template()):
        """Puts the last entry in the place of particle i's own: to ask of each candidate whether it
        is i would take a quarter of the search."""
        own = -1
        for s in range(self.start[search.i], search.place):
            own = ti.max(own, ti.select(self.index[s] == search.i, s, -1))
        if own >= 0:
            search.place -= 1
            self.index[own] = self.index[search.place]

    @ti.func
    def _add_row(self, begin, end, search: ti.template()):
        """Adds the particles of a row that are within reach, i too. Each is written to the next
        place, which advances only if it is within reach: a branch would be mispredicted. A row that
        might not fit into the stretch is only counted."""
        place = search.place
        fits = place + end - begin < search.limit
        last = ti.select(fits, end, begin)
        x, reach2 = search.x, search.reach * search.reach
        for j in range(begin, last):
            r2 = (x - self.particles.x[j]).norm_sqr()
            self.index[place] = j
            place += ti.select(r2 < reach2, 1, 0)
        search.wanted += ti.select(fits, place - search.place, end - begin)
        search.place = place


def neighbours_provided(
    specs: list[LayerSpec], margin: float, reach: str, shared: bool = False
) -> int:
    """Entries that the list provides per particle; shared: where several share a stretch.

    At rest a ball of radius r holds 4/3 pi r^3/V particles. The most neighbours has a coarse
    particle among fine ones; pairs of layers count here if they are next to each other in size, or
    differ by less than MUCH_FINER in mass.
    """
    finer = MUCH_FINER_SHARED if shared else MUCH_FINER
    order = sorted(specs, key=lambda s: s.volume)
    supports, volumes = (np.array([getattr(s, k) for s in order]) for k in ("support", "volume"))
    reaches = REACHES[reach](supports[:, None], supports) + margin * supports.min()
    rank = np.arange(len(order))
    met = (volumes[:, None] <= finer * volumes) | (rank[:, None] <= rank + 1)
    most = (reaches**3 / volumes)[met].max()
    return math.ceil(ROOM * 4.0 / 3.0 * math.pi * most)
