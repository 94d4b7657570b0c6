"""Adaptation: large particles in the depth, small ones at the surface, wherever the water goes.

Every layer owns a band of depths. A particle above its band is split into two of the next finer
layer, one below it is merged with its nearest neighbour of the same layer (after Adams et al.
2007). Mass, momentum and centre of mass are kept to rounding, angular momentum nearly.
"""

from dataclasses import dataclass, replace

import numpy as np
import taichi as ti

from msph.fluid import kernels
from msph.fluid.depth import Depth
from msph.fluid.layers import Layers, LayerSpec
from msph.fluid.neighbours import NeighbourList
from msph.fluid.obstacles import END, Walls
from msph.fluid.particles import Attribute, Particles
from msph.fluid.scan import ExclusiveScan
from msph.launch import data_oriented, kernel

ATTRIBUTES = (
    Attribute("depth", "m", "distance to the free surface, as far as layers ask", carried=False),
    Attribute("settling", "-", "passes to wait before it adapts again", integer=True),
    Attribute("wish", "-", "-1: to be split, 1: to be merged", integer=True, carried=False),
    Attribute("partner", "-", "whom it would merge with", integer=True, carried=False),
    Attribute("alive", "-", "0 for what was merged into another", integer=True, carried=False),
)

# Layers exchange particles where the coarser's mass is twice the finer's, to this share.
RATIO_TOLERANCE = 0.01
# Distance of split halves from their centre, in spacings of what was split.
HALF = 0.35
# Halves nearer than this to it would hardly part: what lies in a corner is not split.
LEAST_HALF = 0.15
# Keeps divisions by what may vanish finite.
TINY = 1e-20
# How far beyond its band's top a particle must lie to be split, in shares of hysteresis. At the
# start: at 0 it would soon merge again, at 1 thin bands lack their layer. In a run: at 1 a sloshing
# tank, 15 spacings deep, made 18 splits in 5 s and its energy rose by .006 %; at 2 one, and .002 %.
EAGER, RELUCTANT = 0.5, 2.0
# Farthest merge, in spacings: across a gap a merge would pop.
FARTHEST_MERGE = 1.25
# Shares of the pool: fuller than the first, bands grow thinner; emptier than the second, thicker.
FULL, ROOMY = 0.95, 0.85
# By how much a pass changes the bands' thickness, and the least share of it.
THINNER, THICKER, THINNEST = 0.9, 1.02, 0.1
# Directions in which halves may lie: axes and diagonals of the faces.
DIRECTIONS = (
    *((1, 0, 0), (0, 1, 0), (0, 0, 1)),
    *((1, 1, 0), (1, -1, 0), (1, 0, 1), (1, 0, -1), (0, 1, 1), (0, 1, -1)),
)


@dataclass(frozen=True)
class AdaptationTerms:
    """Constants of adaptation.

    band: thickness of a layer's band of depths, in its supports (-). hysteresis: share of a
    bound's depth by which a particle must be beyond it, RELUCTANT times as much to be split (-).
    every: steps after which a pass may be due, travel: spacings that the fastest must have gone
    since the last. budget: share of all particles that a pass may split, and merge (-). settle:
    times `every` that what was split or merged waits.
    """

    band: float = 1.25
    hysteresis: float = 0.3
    every: int = 8
    travel: float = 4.0
    budget: float = 0.1
    settle: int = 3


def bands(specs: list[LayerSpec], band: float) -> list[tuple[float, float]]:
    """Depths [m] from and to which each layer belongs; the coarsest's reach down for ever."""
    order = sorted(range(len(specs)), key=lambda k: specs[k].mass)
    found, top = [(0.0, 0.0)] * len(specs), 0.0
    for k in order:
        bottom = top + band * specs[k].support
        found[k] = (top, bottom if k != order[-1] else float("inf"))
        top = bottom
    return found


def coarser_of(specs: list[LayerSpec]) -> list[int]:
    """Of each layer the one that two of its particles merge into, or -1."""
    return [
        next((j for j, b in enumerate(specs) if abs(b.mass / a.mass - 2.0) < RATIO_TOLERANCE), -1)
        for a in specs
    ]


def exact(specs: list[LayerSpec]) -> list[LayerSpec]:
    """The layers with masses that merges double to the last digit: spacings in a scene are rounded,
    and each merge would change the mass of the water."""
    found = list(specs)
    for k in sorted(range(len(specs)), key=lambda k: specs[k].mass):
        coarser = coarser_of(found)[k]
        if coarser >= 0:
            found[coarser] = replace(found[coarser], mass=2.0 * found[k].mass)
    return found


@data_oriented
class Adaptation:
    """Splits and merges the particles of one fluid.

    events counts (splits, merges, splits refused for lack of room) of the last pass; thickness is
    the share of their bands that layers have, below 1 while the pool is nearly full.
    """

    def __init__(
        self,
        walls: Walls,
        layers: Layers,
        particles: Particles,
        neighbours: NeighbourList,
        merge_loss: ti.Field,
        terms: AdaptationTerms,
    ):
        self.layers, self.particles, self.neighbours = layers, particles, neighbours
        self.terms, self.merge_loss = terms, merge_loss
        limits = bands(layers.specs, terms.band)
        self.farthest = max(top for top, _ in limits) * (1.0 + 2.0 * terms.hysteresis)
        self.depth = Depth(walls, layers, particles, self.farthest)
        self.walls = walls
        self.top, self.bottom = (ti.field(ti.f32, shape=layers.count) for _ in range(2))
        self.coarser, self.finer = (ti.field(ti.i32, shape=layers.count) for _ in range(2))
        coarser = coarser_of(layers.specs)
        for k, (top, bottom) in enumerate(limits):
            self.top[k], self.bottom[k] = top, bottom
            self.coarser[k] = coarser[k]
            self.finer[k] = coarser.index(k) if k in coarser else -1
        self.place = ti.field(ti.i32, shape=particles.capacity + 1)
        self.scan = ExclusiveScan(particles.capacity)
        self.tally = ti.field(ti.i32, shape=3)  # splits, merges, refused
        self.next_id = ti.field(ti.i32, shape=())
        self.travelled = ti.field(ti.f32, shape=())  # by the fastest since the last pass, spacings
        self.thickness, self.events, self.steps = 1.0, (0, 0, 0), 0

    def reset(self) -> None:
        """Forgets the run, for the particles were replaced: bands have their full thickness."""
        self.thickness, self.events, self.steps = 1.0, (0, 0, 0), 0
        self.next_id[None] = int(self.particles.numpy("id").max()) + 1
        self.travelled[None] = 0.0

    def fill(self) -> None:
        """Splits what the scene filled too coarsely, before the water moves.

        A particle of a lattice owns a cube; its halves own half of it each and lie in their
        middles, so that they fill the space that the scene gave them and no other: halves that
        look for gaps are pushed apart, and water would start too high. Which way a cube is halved
        is random, for layers all halved one way bear the weight as a crystal, not as a fluid.
        """
        p, rng = self.particles, np.random.default_rng(0)
        spacing = np.array([spec.spacing for spec in self.layers.specs])
        edges = np.repeat(spacing[p.numpy("layer")][:, None], 3, axis=1)
        self.depth.refresh()
        while True:
            self.wish_for(p.count, self.thickness, EAGER)
            split = np.flatnonzero(p.numpy("wish") == -1)
            if len(split) == 0:
                return
            if p.count + len(split) > FULL * p.capacity:
                if self.thickness <= THINNEST:
                    return
                self.thickness *= THINNER
                continue
            axis = (edges[split] * rng.uniform(1.0, 1.1, (len(split), 3))).argmax(axis=1)
            offset = 0.25 * np.eye(3)[axis] * edges[split]
            x = p.numpy("x")[split]
            # Whose half would be in a body is left to the passes, which know of clearances.
            free = self.walls.free(x - offset) & self.walls.free(x + offset)
            if not free.any():
                return
            split, axis, offset = split[free], axis[free], offset[free]
            edges[split, axis] *= 0.5
            self._halve(split, offset)
            edges = np.concatenate([edges, edges[split]])
            self.depth.refresh()

    def _halve(self, split: np.ndarray, offset: np.ndarray) -> None:
        """Puts halves of the particles `split` (k,) at -offset and +offset (k, 3) [m] from them."""
        state = self.particles.state()
        state["layer"][split] = self.finer.to_numpy()[state["layer"][split]]
        halves = {name: values[split] for name, values in state.items()}
        halves["id"] = state["id"].max() + 1 + np.arange(len(split), dtype=np.int32)
        halves["x"] = halves["x"] + offset.astype(np.float32)
        state["x"][split] -= offset.astype(np.float32)
        joined = {name: np.concatenate([state[name], halves[name]]) for name in state}
        self.particles.fill(**joined)
        self.next_id[None] = int(joined["id"].max()) + 1

    def due(self) -> bool:
        """Counts a step; true for those after which a pass is due."""
        self.steps += 1
        if self.steps % self.terms.every:
            return False
        if self.travelled[None] < self.terms.travel:
            self.wait(self.particles.count)
            return False
        self.travelled[None] = 0.0
        return True

    def run(self, budget: float | None = None) -> int:
        """One pass over fresh neighbours; returns how many particles it split and merged.

        budget: share of the particles, by default the terms'. Changes the order and number of the
        particles, so grid and neighbours are void afterwards.
        """
        p, n = self.particles, self.particles.count
        most = max(8, int((self.terms.budget if budget is None else budget) * n))
        self.depth.refresh()
        self.tally.fill(0)
        self.wish_for(n, self.thickness, RELUCTANT)
        self.find_partners(n)
        self.merge(n, most)
        self.split(n, most, p.capacity)
        splits, merges, refused = self.tally.to_numpy().tolist()
        splits = min(splits, most, p.capacity - n)
        self.events = splits, min(merges, most), refused
        p.count = n + splits
        if merges:
            self.scan.run(p.alive, self.place)
            p.compact(self.place, p.alive, n + splits)
            p.count = self.place[p.capacity]
        self._keep_room(refused)
        return splits + self.events[1]

    def _keep_room(self, refused: int) -> None:
        full = self.particles.count / self.particles.capacity
        if refused or full > FULL:
            self.thickness = max(THINNEST, THINNER * self.thickness)
        elif full < ROOMY:
            self.thickness = min(1.0, THICKER * self.thickness)

    @kernel
    def wait(self, n: ti.i32):
        """What was split or merged has waited once more."""
        for i in range(n):
            self.particles.settling[i] = ti.max(self.particles.settling[i] - 1, 0)

    @kernel
    def wish_for(self, n: ti.i32, thickness: ti.f32, reluctant: ti.f32):
        """What each particle should become, by its depth and its layer's band."""
        for i in range(self.particles.capacity):
            self.particles.alive[i] = ti.select(i < n, 1, 0)
        for i in range(n):
            layer = self.particles.layer[i]
            depth = self.depth.at(self.particles.x[i])
            self.particles.depth[i] = depth
            waiting = self.particles.settling[i]
            self.particles.settling[i] = ti.max(waiting - 1, 0)
            top, bottom = self.top[layer] * thickness, self.bottom[layer] * thickness
            rise = reluctant * self.terms.hysteresis
            above = depth < top * (1.0 - rise) and self.finer[layer] >= 0
            below = depth > bottom * (1.0 + self.terms.hysteresis) and self.coarser[layer] >= 0
            wish = ti.select(above, -1, ti.select(below, 1, 0))
            self.particles.wish[i] = ti.select(waiting > 0, 0, wish)

    @kernel
    def find_partners(self, n: ti.i32):
        """The nearest of the same layer that would merge too."""
        for i in range(n):
            best = -1
            if self.particles.wish[i] == 1:
                layer, x = self.particles.layer[i], self.particles.x[i]
                nearest = FARTHEST_MERGE * self.layers.spacing[layer]
                for s in range(self.neighbours.start[i], self.neighbours.mirrors[i]):
                    j = self.neighbours.index[s]
                    r = (self.particles.x[j] - x).norm()
                    same = self.particles.layer[j] == layer and self.particles.wish[j] == 1
                    if same and r < nearest:
                        nearest, best = r, j
            self.particles.partner[i] = best

    @kernel
    def merge(self, n: ti.i32, most: ti.i32):
        """Mutual nearest pairs become one; the kinetic energy they lose goes to merge_loss."""
        for i in range(n):
            j, order = self.particles.partner[i], most
            if j > i and self.particles.partner[j] == i:
                order = ti.atomic_add(self.tally[1], 1)
            if order < most:
                layer = self.particles.layer[i]
                mass, dv = self.layers.mass[layer], self.particles.v[i] - self.particles.v[j]
                r = self.particles.x[i] - self.particles.x[j]
                self.particles.x[i] -= 0.5 * r
                self.particles.v[i] -= 0.5 * dv
                # (1/2) m_a m_b/(m_a + m_b) |dv|^2 of equal masses.
                self.merge_loss[None] += 0.25 * mass * dv.norm_sqr()
                self.hand_over(i, j, 2.0 * mass, 0.5 * mass * r.cross(dv))
                p = self.particles
                for each in ti.static((p.pressure, p.multiplier, p.earlier)):
                    each[i] = 0.5 * (each[i] + each[j])
                self.particles.layer[i] = self.coarser[layer]
                self.particles.settling[i] = self.terms.settle
                self.particles.alive[j] = 0

    @ti.func
    def hand_over(self, i, j, mass, spin):
        """Gives the angular momentum [kg m^2/s] that a merged pair had about its centre to it and
        a neighbour, as equal and opposite impulses: r x J = spin if r is normal to spin, and of the
        neighbours that do not merge, the one nearest to normal is taken."""
        x, best, least = self.particles.x[i], -1, 1.0
        for s in range(self.neighbours.start[i], self.neighbours.mirrors[i]):
            k = self.neighbours.index[s]
            if k != j and self.particles.partner[k] < 0:
                r = self.particles.x[k] - x
                cosine = abs(r.dot(spin)) / ti.max(r.norm() * spin.norm(), TINY)
                if cosine < least:
                    least, best = cosine, k
        if best >= 0:
            r = self.particles.x[best] - x
            impulse = spin.cross(r) / ti.max(r.norm_sqr(), TINY)
            m_k = self.layers.mass[self.particles.layer[best]]
            given = impulse.dot(self.particles.v[best] - self.particles.v[i])
            given += 0.5 * impulse.norm_sqr() * (1.0 / m_k + 1.0 / mass)
            self.merge_loss[None] -= given
            self.particles.v[i] -= impulse / mass
            # Several merges may choose the same neighbour.
            self.particles.v[best] += impulse / m_k

    @kernel
    def split(self, n: ti.i32, most: ti.i32, capacity: ti.i32):
        """One becomes two, on either side of it where the water is thinnest.

        The first `most` find a place, short of capacity; the rest stays as it is.
        """
        for i in range(n):
            offset, place = ti.Vector([0.0, 0.0, 0.0]), most
            if self.particles.wish[i] == -1:
                offset = self.widest_gap(i)
                if offset.norm() > LEAST_HALF * self.layers.spacing[self.particles.layer[i]]:
                    place = ti.atomic_add(self.tally[0], 1)
            j = n + place
            if place < most and j >= capacity:
                self.tally[2] += 1
            elif place < most:
                layer = self.finer[self.particles.layer[i]]
                self.particles.x[j] = self.particles.x[i] + offset
                self.particles.x[i] -= offset
                self.particles.v[j] = self.particles.v[i]
                self.particles.pressure[j] = self.particles.pressure[i]
                self.particles.multiplier[j] = self.particles.multiplier[i]
                self.particles.earlier[j] = self.particles.earlier[i]
                self.particles.hidden[j] = self.particles.hidden[i]
                self.particles.layer[i] = layer
                self.particles.layer[j] = layer
                self.particles.id[j] = ti.atomic_add(self.next_id[None], 1)
                self.particles.settling[i] = self.terms.settle
                self.particles.settling[j] = self.terms.settle
                self.particles.alive[j] = 1

    @ti.func
    def widest_gap(self, i):
        """The offset [m] of halves of particle i that meets the least density."""
        layer, x = self.particles.layer[i], self.particles.x[i]
        finer = self.finer[layer]
        # A half must not be moved by a wall, which would move their centre.
        room = ti.min(x, self.walls.size - x)
        if ti.static(self.walls.count > 0):
            room = ti.min(room, self.walls.clearance(x, END))
        best, least = ti.Vector([0.0, 0.0, 0.0]), 1e9
        for direction in ti.static(DIRECTIONS):
            unit = ti.Vector(direction, ti.f32).normalized()
            offset = HALF * self.layers.spacing[layer] * unit
            offset *= ti.min(1.0, (room / ti.max(abs(offset), 1e-9)).min())
            c = 0.0
            for s in range(self.neighbours.start[i], self.neighbours.mirrors[i]):
                j = self.neighbours.index[s]
                other = self.particles.layer[j]
                h = 1.0 / self.layers.per_h[finer, other]
                r_ij = x - self.particles.x[j]
                near = kernels.quartic((r_ij + offset).norm(), h)
                c += self.layers.volume[other] * (near + kernels.quartic((r_ij - offset).norm(), h))
            # Halves that a wall pushes together would see too much of each other.
            other_half = kernels.quartic(2.0 * offset.norm(), self.layers.support[finer])
            c += 2.0 * self.layers.volume[layer] * other_half
            if c < least:
                least, best = c, offset
        return best
