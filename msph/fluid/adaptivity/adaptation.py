"""Adaptation: splits particles near the free surface and merges particles below.

Every layer has a band of depths. A particle above its band splits into two of the next finer layer;
two neighbours of a layer below their band merge into one of the next coarser layer (after Adams et
al. 2007). Mass, momentum and centre of mass are conserved to rounding, angular momentum nearly.
"""

import numpy as np
import taichi as ti

from msph.fluid.adaptivity.bands import AdaptationParameters, finer_of
from msph.fluid.adaptivity.surface_distance import SurfaceDistance
from msph.fluid.boundary.body_shapes import BEGIN
from msph.fluid.particles import kernels
from msph.fluid.particles.particles import Attribute
from msph.fluid.projection.discretisation import Discretisation
from msph.fluid.small_numbers import MIN_DIVISOR
from msph.launches import data_oriented, kernel

ATTRIBUTES = (
    Attribute("depth", "m", "depth below the free surface at the last pass", view="depth"),
    Attribute(
        "settling", "-", "remaining wait before a split or merge", integer=True, inherited=False
    ),
    Attribute("mark", "-", "-1: split, 1: merge", integer=True, carried=False),
    Attribute("partner", "-", "particle to merge with, or -1", integer=True, carried=False),
)

# Distance of a split's halves from their centre, in spacings of the split particle.
SPLIT_OFFSET = 0.35
# Smallest such distance; particles closer to walls and bodies are not split.
MIN_SPLIT_OFFSET = 0.15
# Factors (-) of `hysteresis` for splits, initially and in a run. Initially, 0 would cause merges
# soon after the start, and 1 would leave thin bands without particles. In a run, a sloshing tank
# splits 18 particles in 5 s with 1, and one with 2; each split adds some energy.
INITIAL_SPLIT_HYSTERESIS, SPLIT_HYSTERESIS = 0.5, 2.0
# Largest distance of a merging pair, in spacings: merges over larger gaps are visible.
MAX_MERGE_DISTANCE = 1.25
# Used share of the capacity (-) above which bands shrink, and below which they grow.
SHRINK_ABOVE, GROW_BELOW = 0.95, 0.85
# Factors of the bands' thickness per pass, and its smallest value (-).
SHRINK, GROW, MIN_THICKNESS = 0.9, 1.02, 0.1
# Directions of a split's halves: the axes and the diagonals between two of them.
DIRECTIONS = (
    *((1, 0, 0), (0, 1, 0), (0, 0, 1)),
    *((1, 1, 0), (1, -1, 0), (1, 0, 1), (1, 0, -1), (0, 1, 1), (0, 1, -1)),
)


@data_oriented
class Adaptation(Discretisation):
    """Splits and merges the particles of one fluid.

    totals: numbers of splits and merges since the initial arrangement. steps: number of steps.
    thickness (-): factor of all bands, below 1 while the capacity is nearly used up. travelled:
    distance of the fastest particle since the last pass, in spacings. merge_loss [J]: kinetic
    energy dissipated by merges. inherited: fields of the attributes that halves of a split copy and
    merges average.
    """

    parameters: AdaptationParameters

    def __init__(self, shared: Discretisation):
        super().__init__(shared)
        self.inherited, self.merge_loss = shared.particles.inherited, shared.impulses.merge_loss
        self.depth = SurfaceDistance(shared)
        self.coarser, self.finer = shared.layers.coarser, shared.layers.finer
        unit = np.array(DIRECTIONS) / np.linalg.norm(DIRECTIONS, axis=1, keepdims=True)
        self.directions = ti.Vector.field(3, ti.f32, shape=len(DIRECTIONS))
        self.directions.from_numpy(unit.astype(np.float32))
        self.tally = ti.field(ti.i32, shape=3)  # splits, merges, refused
        self.next_id = ti.field(ti.i32, shape=())

    def load(self, parameters: AdaptationParameters) -> None:
        """Takes the parameters of a scene; its bands are columns of the table by layer."""
        self.parameters = parameters
        # Launched without particles: compiles the kernels before the first frame.
        self.decrement_wait(0)
        self.removal.compile()

    def reset(self) -> None:
        """Resets counters and thickness after the particles were replaced."""
        self.thickness, self.steps = 1.0, 0
        self.totals, self.travelled = np.zeros(2, int), 0.0
        self.next_id[None] = int(self.particles.numpy("id").max()) + 1

    def number_after(self, last: int) -> None:
        """Gives later particles ids above `last`."""
        self.next_id[None] = max(self.next_id[None], last + 1)

    def state(self) -> dict[str, float]:
        """Returns the values that a checkpoint stores."""
        return {
            "adaptation_steps": self.steps,
            "adaptation_thickness": self.thickness,
            "adaptation_travelled": self.travelled,
            "adaptation_next_id": self.next_id[None],
        }

    def restore(self, state: dict[str, float]) -> None:
        """Restores the values that state() returned."""
        self.steps, self.thickness = int(state["adaptation_steps"]), state["adaptation_thickness"]
        self.travelled = state["adaptation_travelled"]
        self.next_id[None] = int(state["adaptation_next_id"])

    def fill(self) -> None:
        """Splits the initial particles that are too coarse for their depth.

        Each particle of the initial lattice fills a cuboid. A split halves the cuboid along its
        longest edge and puts a particle at the centre of each half, which keeps the water level;
        split() would place halves in gaps and raise it. Among edges of nearly equal length the
        choice is random: layers halved along a single axis would carry weight like a crystal.
        """
        p, rng = self.particles, np.random.default_rng(0)
        spacing = np.array([spec.spacing for spec in self.layers.specs])
        edges = np.repeat(spacing[p.numpy("layer")][:, None], 3, axis=1)
        self.depth.refresh()
        while True:
            self.mark_particles(p.count, self.thickness, INITIAL_SPLIT_HYSTERESIS)
            split = np.flatnonzero(p.numpy("mark") == -1)
            if len(split) == 0:
                return
            if p.count + len(split) > SHRINK_ABOVE * p.capacity:
                if self.thickness <= MIN_THICKNESS:
                    return
                self.thickness *= SHRINK
                continue
            axis = (edges[split] * rng.uniform(1.0, 1.1, (len(split), 3))).argmax(axis=1)
            offset = 0.25 * np.eye(3)[axis] * edges[split]
            x = p.numpy("x")[split]
            # Particles with a half inside a body are left to run(), which avoids bodies.
            free = self.boundary.free(x - offset) & self.boundary.free(x + offset)
            if not free.any():
                return
            split, axis, offset = split[free], axis[free], offset[free]
            edges[split, axis] *= 0.5
            self._halve(split, offset)
            edges = np.concatenate([edges, edges[split]])
            self.depth.refresh()

    def _halve(self, split: np.ndarray, offset: np.ndarray) -> None:
        """Replaces particles `split` (k,) by halves at -offset and +offset (k, 3) [m] from them."""
        state = self.particles.state()
        state["layer"][split] = np.array(finer_of(self.layers.specs))[state["layer"][split]]
        halves = {name: values[split] for name, values in state.items()}
        halves["id"] = state["id"].max() + 1 + np.arange(len(split), dtype=np.int32)
        halves["x"] = halves["x"] + offset.astype(np.float32)
        state["x"][split] -= offset.astype(np.float32)
        joined = {name: np.concatenate([state[name], halves[name]]) for name in state}
        self.particles.fill(**joined)
        self.next_id[None] = int(joined["id"].max()) + 1

    def pass_due(self) -> bool:
        """Counts a step; returns True if a pass is due, every `every` steps and after `travel`."""
        self.steps += 1
        if self.steps % self.parameters.every:
            return False
        if self.travelled < self.parameters.travel:
            self.decrement_wait(self.particles.count)
            return False
        self.travelled = 0.0
        return True

    def run(self, budget: float | None = None) -> int:
        """Runs one pass of splits and merges and returns their number. Requires a fresh neighbour
        list.

        budget: largest share (-) of the particles that may split, and that may merge; default: the
        parameter `budget`. Order and number of particles change: grid and neighbour list become
        invalid.
        """
        p, n = self.particles, self.particles.count
        limit = max(8, int((self.parameters.budget if budget is None else budget) * n))
        self.depth.refresh()
        self.tally.fill(0)
        self.mark_particles(n, self.thickness, SPLIT_HYSTERESIS)
        self.find_partners(n)
        self.merge(n, limit)
        self.split(n, limit, p.capacity)
        splits, merges, refused = self.tally.to_numpy().tolist()
        splits = min(splits, limit, p.capacity - n)
        merges = min(merges, limit)
        self.totals += splits, merges
        p.count = n + splits
        if merges:
            self.removal.run(n + splits)
        self._adapt_thickness(refused)
        return splits + merges

    def _adapt_thickness(self, refused: int) -> None:
        """Shrinks the bands if splits were refused or the capacity is nearly used up; grows them
        if the capacity has room."""
        full = self.particles.count / self.particles.capacity
        if refused or full > SHRINK_ABOVE:
            self.thickness = max(MIN_THICKNESS, SHRINK * self.thickness)
        elif full < GROW_BELOW:
            self.thickness = min(1.0, GROW * self.thickness)

    @kernel
    def decrement_wait(self, n: ti.i32):
        """Decrements `settling` of all particles; called every `every` steps."""
        for i in range(n):
            self.particles.settling[i] = ti.max(self.particles.settling[i] - 1, 0)

    @kernel
    def mark_particles(self, n: ti.i32, thickness: ti.f32, factor: ti.f32):
        """Sets alive, depth [m], settling, and mark by depth and band: -1 split, 1 merge, 0
        neither.

        factor: of the hysteresis of splits (-).
        """
        for i in range(n):
            self.particles.alive[i] = 1
            layer = self.particles.layer[i]
            depth = self.depth.at(self.particles.x[i])
            self.particles.depth[i] = depth
            waiting = self.particles.settling[i]
            self.particles.settling[i] = ti.max(waiting - 1, 0)
            top = self.layers.top[layer] * thickness
            bottom = self.layers.bottom[layer] * thickness
            hysteresis = self.constants.hysteresis[None]
            rise = factor * hysteresis
            above = depth < top * (1.0 - rise) and self.finer[layer] >= 0
            below = depth > bottom * (1.0 + hysteresis) and self.coarser[layer] >= 0
            mark = ti.select(above, -1, ti.select(below, 1, 0))
            held = waiting > 0 or self.particles.prescribed[i] > 0
            self.particles.mark[i] = ti.select(held, 0, mark)

    @kernel
    def find_partners(self, n: ti.i32):
        """Sets partner to the nearest particle of the layer that is also marked to merge, or -1."""
        for i in range(n):
            best = -1
            if self.particles.mark[i] == 1:
                layer, x = self.particles.layer[i], self.particles.x[i]
                nearest = MAX_MERGE_DISTANCE * self.layers.spacing[layer]
                for s in range(self.neighbours.start[i], self.neighbours.end[i]):
                    j = self.neighbours.index[s]
                    r = (self.particles.x[j] - x).norm()
                    same = self.particles.layer[j] == layer and self.particles.mark[j] == 1
                    if same and r < nearest:
                        nearest, best = r, j
            self.particles.partner[i] = best

    @kernel
    def merge(self, n: ti.i32, limit: ti.i32):
        """Merges mutual partners at their centre of mass with their mean velocity."""
        for i in range(n):
            j, order = self.particles.partner[i], limit
            if j > i and self.particles.partner[j] == i:
                order = ti.atomic_add(self.tally[1], 1)
            if order < limit:
                layer = self.particles.layer[i]
                mass, dv = self.layers.mass[layer], self.particles.v[i] - self.particles.v[j]
                r = self.particles.x[i] - self.particles.x[j]
                self.particles.x[i] -= 0.5 * r
                self.particles.v[i] -= 0.5 * dv
                # (1/2) m_a m_b/(m_a + m_b) |dv|^2 of equal masses.
                self.merge_loss.add(i, 0.25 * mass * dv.norm_sqr())
                self.keep_angular_momentum(i, j, 2.0 * mass, 0.5 * mass * r.cross(dv))
                for each in ti.static(self.inherited):
                    each[i] = 0.5 * (each[i] + each[j])
                self.particles.layer[i] = self.coarser[layer]
                self.particles.settling[i] = self.constants.settle[None]
                self.particles.alive[j] = 0

    @ti.func
    def keep_angular_momentum(self, i, j, mass, spin):
        """Conserves the angular momentum `spin` [kg m^2/s] of a merged pair about its centre.

        The merged particle i of `mass` [kg] and one neighbour at r get opposite impulses J with
        r x J = spin. A solution exists only for r normal to spin: the neighbour closest to this
        direction is chosen, among those that do not merge themselves.
        """
        x, best, least = self.particles.x[i], -1, 1.0
        for s in range(self.neighbours.start[i], self.neighbours.end[i]):
            k = self.neighbours.index[s]
            if k != j and self.particles.partner[k] < 0:
                r = self.particles.x[k] - x
                cosine = abs(r.dot(spin)) / ti.max(r.norm() * spin.norm(), MIN_DIVISOR)
                if cosine < least:
                    least, best = cosine, k
        if best >= 0:
            r = self.particles.x[best] - x
            impulse = spin.cross(r) / ti.max(r.norm_sqr(), MIN_DIVISOR)
            m_k = self.layers.mass[self.particles.layer[best]]
            energy = impulse.dot(self.particles.v[best] - self.particles.v[i])
            energy += 0.5 * impulse.norm_sqr() * (1.0 / m_k + 1.0 / mass)
            self.merge_loss.add(i, -energy)
            self.particles.v[i] -= impulse / mass
            # Atomic: several merges may choose the same neighbour.
            self.particles.v[best] += impulse / m_k

    @kernel
    def split(self, n: ti.i32, limit: ti.i32, capacity: ti.i32):
        """Replaces marked particles by two halves at +- split_offset().

        Splits at most `limit` particles, and no more than `capacity` allows.
        """
        for i in range(n):
            offset, order = ti.Vector([0.0, 0.0, 0.0]), limit
            if self.particles.mark[i] == -1:
                offset = self.split_offset(i)
                if offset.norm() > MIN_SPLIT_OFFSET * self.layers.spacing[self.particles.layer[i]]:
                    order = ti.atomic_add(self.tally[0], 1)
            j = n + order
            if order < limit and j >= capacity:
                self.tally[2] += 1
            elif order < limit:
                layer = self.finer[self.particles.layer[i]]
                self.particles.x[j] = self.particles.x[i] + offset
                self.particles.x[i] -= offset
                self.particles.v[j] = self.particles.v[i]
                for each in ti.static(self.inherited):
                    each[j] = each[i]
                self.particles.layer[i] = layer
                self.particles.layer[j] = layer
                self.particles.links[j] = 0  # until the next search
                self.particles.id[j] = ti.atomic_add(self.next_id[None], 1)
                self.particles.settling[i] = self.constants.settle[None]
                self.particles.settling[j] = self.constants.settle[None]
                self.particles.alive[j] = 1

    @ti.func
    def split_offset(self, i):
        """Returns the offset [m] of a split's halves, in the direction of the lowest density."""
        layer, x = self.particles.layer[i], self.particles.x[i]
        finer = self.finer[layer]
        # Halves stay clear of walls: a wall that pushes a half back would move the centre of mass.
        # Outside the box, next to an open top, the offset is 0: no split.
        free = ti.max(ti.min(x, self.constants.walls[None] - x), 0.0)
        if ti.static(self.traits.bodies):
            free = ti.min(free, self.boundary.clearance(x, BEGIN))
        best, least = ti.Vector([0.0, 0.0, 0.0]), 1e9
        for d in range(self.directions.shape[0]):
            offset = SPLIT_OFFSET * self.layers.spacing[layer] * self.directions[d]
            offset *= ti.min(1.0, (free / ti.max(abs(offset), 1e-9)).min())
            c = 0.0
            for s in range(self.neighbours.start[i], self.neighbours.end[i]):
                j = self.neighbours.index[s]
                other = self.particles.layer[j]
                h = 1.0 / self.layers.per_h[finer, other]
                r_ij = x - self.particles.x[j]
                near = kernels.quartic((r_ij + offset).norm(), h)
                c += self.layers.volume[other] * (near + kernels.quartic((r_ij - offset).norm(), h))
            # The halves also contribute to each other's density, more so at the shorter offsets
            # near walls.
            other_half = kernels.quartic(2.0 * offset.norm(), self.layers.support[finer])
            c += 2.0 * self.layers.volume[layer] * other_half
            if c < least:
                least, best = c, offset
        return best
