"""Simulation of one scene: state, time and steps."""

import math
import weakref
from collections.abc import Callable
from time import perf_counter
from typing import NamedTuple

import numpy as np

from msph.errors import BlowUpError
from msph.fluid import checkpoint
from msph.fluid.boundary.body_faces import samples
from msph.fluid.boundary.gap_pressure import MAX_SAMPLES
from msph.fluid.boundary.opening import Opening, Valve
from msph.fluid.boundary.pistons import Stroke
from msph.fluid.boundary.rigid_bodies import Body, centre, end_block
from msph.fluid.boundary.walls import wall_constants
from msph.fluid.constants import MAX_OPENINGS
from msph.fluid.external_forces import STILL, ExternalForces, Vec3, as_vector
from msph.fluid.methods import Parameters, all_attributes, solver_of
from msph.fluid.moving_box import MovingBox
from msph.fluid.particles.grid import cells_of
from msph.fluid.particles.images import WORDS, image_capacity
from msph.fluid.particles.layers import LayerSpec
from msph.fluid.particles.neighbour_list import list_capacity
from msph.fluid.particles.particles import CORE
from msph.fluid.plan import Plan
from msph.fluid.room import FIRST, MAX_BODIES, grown
from msph.fluid.stages import Stage, no_stage
from msph.fluid.trapped_water import check_trapped_water
from msph.fluid.world import give_back, take, take_again

# A step is lengthened once it is this many times shorter than allowed (-): after each change of
# length the pressure solve takes three times the iterations.
LENGTHENING_RATIO = 1.1
# Bytes of an i32 or f32, the only types of the fields.
WORD = 4
# Least distance of added particles from all others, over the larger spacing of both: more than the
# 0.87 of the largest hole of a cubic lattice.
LEAST_GAP = 0.9
# Name of the piston that a user adds.
MOVING_WALL = "the moving wall"


class NoWaterError(ValueError):
    """Raised if all initial particles are inside bodies."""


def footprint(
    size: tuple[float, float, float],
    specs: list[LayerSpec],
    count: int,
    parameters: Parameters,
) -> dict[str, int]:
    """Returns how many numbers (of WORD bytes) `count` particles in a region of `size` [m] need, by
    purpose."""
    solver = solver_of(parameters)
    entries = list_capacity(specs, solver.LIST_MARGIN, solver.list_form(parameters), count)
    # Attributes, and the fields place, cell, start and end of the sort and the list.
    words = sum(a.words for a in CORE + all_attributes()) + 4
    images = image_capacity(size, specs, count, False) if solver.HAS_BODIES else 0
    return {
        "cells": 2 * grown(FIRST.cells, sum(cells_of(size, specs))),
        "neighbours": (1 + solver.PER_ENTRY) * grown(FIRST.entries, entries),
        "images": WORDS * grown(FIRST.images, images),
        "particles": words * grown(FIRST.particles, count),
    }


class Mark(NamedTuple):
    """State of a simulation; totals of the ledger; mass [kg] that was spilt and that left through
    outflows; impulses and angular impulses of the water on bodies, and impulse on bodies that were
    removed."""

    state: dict[str, np.ndarray]
    totals: list[np.ndarray]
    left: tuple[float, float]
    received: tuple[np.ndarray, np.ndarray, np.ndarray]


class OpeningError(ValueError):
    """An inflow or outflow that cannot be built. opening: its index in the plan."""

    def __init__(self, opening: int, problem: str):
        super().__init__(problem)
        self.opening = opening


class FullError(ValueError):
    """Raised if water is added beyond the largest number of particles."""


class Simulation:
    """Simulation of one scene, as a Plan describes it.

    time [s] is simulated time, at the end of a frame; the particles are `ahead` [s] later, less
    than a step; steps counts solver steps since the last reset, iterations the
    iterations of their pressure solves; left_out counts the initial particles inside bodies, which
    are dropped, and mass_left_out [kg] is their mass. Raises NoWaterError if no particles remain,
    OpeningError for an inflow or outflow in a body.
    """

    time: float
    ahead: float

    def __init__(self, plan: Plan):
        self.plan, self.size, self.region = plan, plan.size, plan.region
        # Coordinates [m] of the far walls, (3,).
        self.walls = np.array(wall_constants(plan.size, plan.open_top)["walls"], np.float32)
        self.world = take(plan.needed)
        self._lease = weakref.finalize(self, give_back, self.world)
        parts = self.world.parts
        self.layers, self.particles, self.grid = parts.layers, parts.particles, parts.grid
        self.boundary, self.contact, self.rim = parts.boundary, parts.contact, parts.rim
        self.openings = parts.openings
        self.world.parts.gaps.recorded = False
        self.solver = self.world.load(plan)
        free = self.boundary.free(plan.initial["x"])
        self.left_out = len(free) - int(free.sum())
        masses = np.array([s.mass for s in plan.specs])
        self.mass_left_out = float(masses[plan.initial["layer"][~free]].sum())
        if not free.any():
            self.close()
            raise NoWaterError(f"all {len(free)} particles are inside bodies")
        for k, opening in enumerate(plan.openings):
            try:
                self._check_opening(opening)
            except ValueError as error:
                self.close()
                raise OpeningError(k, str(error)) from None
        self.initial = {name: values[free] for name, values in plan.initial.items()}
        self._capacity = self.particles.capacity = max(plan.capacity or 0, int(free.sum()))
        self.reset()

    def record_forces(self) -> None:
        """Makes forces on bodies in prescribed motion hold in narrow gaps, too (gap_pressure.py);
        those on floating bodies always do."""
        self.world.parts.gaps.record()

    def close(self) -> None:
        """Returns the fields to the stock; the simulation is unusable afterwards."""
        self._lease()

    def park(self) -> None:
        """Returns the fields to the stock until unpark(), so that another simulation can use them
        with their compiled kernels; the state moves to the host."""
        self._parked = self.mark()
        self._lease()

    def unpark(self) -> None:
        """Continues after park(), in the same world, which must be in the stock."""
        take_again(self.world)
        self._lease = weakref.finalize(self, give_back, self.world)
        capacity = self._capacity
        self.world.load(self.plan)
        self.particles.capacity = capacity
        self.undo(self._parked)

    def reset(self) -> None:
        """Restores the initial state at time zero."""
        self.start_from(self.initial, 0.0, 0)
        self.solver.arrange()
        self.openings.fill_pipes(self.plan.openings, STILL)
        self.world.parts.impulses.clear()

    def warm_up(self, duration: float) -> None:
        """Compiles all kernels by simulating `duration` [s], then resets."""
        self.advance(duration, ExternalForces())
        self.measure_density()
        self.reset()

    def advance(
        self,
        duration: float,
        external: ExternalForces | MovingBox,
        stage: Stage = no_stage,
        budget: float | None = None,
        clock: Callable[[], float] = perf_counter,
        on_progress: Callable[[float], None] | None = None,
        until: float | None = None,
        free: bool = False,
    ) -> float:
        """Simulates `duration` [s] in steps no longer than the solver allows; returns the time [s]
        simulated. free: the last step may end after `duration`; otherwise steps are shortened so
        that the last one ends with it.

        The result is less than `duration` only if `budget` [s] of wall-clock time is exceeded, or
        if at least `until` [s] are simulated, by which a replay repeats an earlier result; it is
        positive in any case. Particles are sorted into the grid afterwards, as whitewater requires.
        stage(name) is entered around each part of a step (profiler hook); on_progress is called
        after each step with the finished share (0 to 1). Raises TrappedWaterError if a moving body
        compresses enclosed water, BlowUpError if no step is short enough, AllSpiltError if no water
        is left in an open box.
        """
        deadline = math.inf if budget is None else clock() + budget
        left, forces = duration - self.ahead, external.at(self.time, 0.0)
        floating, since = self.boundary.floating, self.reached
        before = floating.poses()
        rounding = 1e-6 * duration
        while left > rounding:
            now = self.time + duration - left
            if self.boundary.driven:
                longest, excess = self.solver.longest_step(), self.solver.density.largest_excess
                check_trapped_water(
                    self.boundary, self.layers, self.particles, forces, longest, excess, now
                )
            dt = self.last_step = self._next_step(left, duration if free else None, forces)
            forces = external.at(now, dt)
            self.openings.begin(now + dt)
            self.solver.step(dt, forces, stage)
            self._spill(dt, forces)
            self._pour(dt, forces)
            left -= dt
            self.steps += 1
            self.iterations += self.solver.iterations
            if on_progress:
                on_progress(1.0 - max(left, 0.0) / duration)
            if clock() >= deadline or (until is not None and duration - left >= until):
                break
        with stage("neighbours"):
            self.grid.refresh()
        done = duration - left if left > rounding else duration
        self.time, self.ahead = self.time + done, max(-left, 0.0) if -left > rounding else 0.0
        self.rim.fall(done, forces.apparent_gravity)
        if floating.applied.any():
            given = floating.applied_since(before, self.reached - since)
            self.world.parts.impulses.add_user(*given)
        return done

    @property
    def reached(self) -> float:
        """Time [s] of the particles and bodies."""
        return self.time + self.ahead

    def _spill(self, dt: float, external: ExternalForces) -> None:
        """Removes the particles that left the box in a step of dt [s]."""
        self._take_out(self.openings.take(dt), external.gravity)

    def _take_out(self, taken: np.ndarray, gravity: Vec3) -> None:
        """Removes the particles of the indices `taken` (k,), and those that left the box."""
        if self.rim.spill(gravity, taken):
            self.grid.invalidate()
            self.world.parts.neighbours.moved(math.inf)

    def _pour(self, dt: float, external: ExternalForces) -> None:
        """Adds the water that flowed in during a step of dt [s]."""
        if self.openings.inlets and self.openings.pour(dt, external.gravity):
            self.solver.particles_added(self.openings.top_speed)

    def add(self, x: np.ndarray, v: np.ndarray, layer: int, gravity: Vec3) -> int:
        """Adds particles of a layer at x [m] with velocities v [m/s], (n, 3), except where they
        overlap water, walls or bodies; returns their number. gravity [m/s^2]: for their potential
        energy. Raises FullError, and adds none, if they are too many."""
        spec, size = self.layers.specs[layer], np.array(self.size)
        margin = 0.5 * spec.spacing
        free = ((x >= margin) & (x <= size - margin)).all(axis=1) & self.boundary.free(x)
        held, spacings = self.particles.numpy("x"), np.array([s.spacing for s in self.layers.specs])
        gaps = LEAST_GAP * np.maximum(spec.spacing, spacings[self.particles.numpy("layer")])
        for k in np.flatnonzero(free):
            near = ((held - x[k]) ** 2).sum(axis=1) < gaps**2
            added = ((x[:k][free[:k]] - x[k]) ** 2).sum(axis=1) < (LEAST_GAP * spec.spacing) ** 2
            free[k] = not (near.any() or added.any())
        x, v = x[free], v[free]
        if self.particles.count + len(x) > self.particles.capacity:
            raise FullError(f"the pool is full: at most {self.particles.capacity:,} particles")
        if len(x):
            self.particles.extend(x, v, layer)
            self.world.parts.impulses.add_water(spec.mass, x, v, np.array(gravity))
            self.solver.particles_added(float(np.linalg.norm(v, axis=1).max()))
        return len(x)

    def add_body(self, body: Body, gravity: Vec3) -> None:
        """Adds a floating block or ball until the next reset. Water in its place is removed and
        counts as an outflow: pushed out at once, it would burst. gravity [m/s^2]: for the potential
        energy. Raises FullError if there are too many bodies, if the body overlaps another body or
        a wall, or if the method has no bodies."""
        self._check_bodies()
        (points, _), at = samples(body, self.layers.finest.spacing, MAX_SAMPLES), centre(body)
        x = at + points
        if (x < 0.0).any() or (x > self.walls).any() or not self.boundary.free(x).all():
            raise FullError("there is no room: the body overlaps another body or a wall")
        floating = self.boundary.floating
        momentum, kinetic = floating.momentum(), floating.kinetic()
        self.take_body(body)
        inside = np.flatnonzero(~self.boundary.free(self.particles.numpy("x")))
        self._take_out(inside.astype(np.int32), gravity)
        self.solver.particles_moved()
        energy = floating.kinetic() - kinetic - floating.mass[-1] * float(at @ np.array(gravity))
        self.world.parts.impulses.add_user(as_vector(floating.momentum() - momentum), energy)

    def _check_bodies(self) -> None:
        """Raises FullError if no body can be added."""
        if not self.plan.method.HAS_BODIES:
            raise FullError("this method has no bodies")
        if self.boundary.count == MAX_BODIES:
            raise FullError(f"at most {MAX_BODIES} bodies")

    def take_body(self, body: Body) -> None:
        """Adds a body without checking whether there is room."""
        self.boundary.add(body, self.reached)
        self.world.prepare_bodies()

    @property
    def piston(self) -> Stroke | None:
        """Motion of the present piston, None without one."""
        found = (b.motion for b in self.boundary.bodies if isinstance(b.motion, Stroke))
        return next(found, None)

    def add_piston(self, stroke: Stroke) -> None:
        """Puts a piston in place of a wall until remove_piston() or the next reset. Raises
        FullError if there are too many bodies, or if the method has none."""
        self._check_bodies()
        reach = max(spec.support for spec in self.layers.specs)
        self.take_body(end_block(self.size, reach, stroke.inwards, 0.0, stroke, MOVING_WALL))
        self.solver.particles_moved()

    def remove_piston(self) -> None:
        """Removes the piston; the wall behind it mirrors water again."""
        self.contact.push_bodies()
        which = next(k for k, b in enumerate(self.boundary.bodies) if b.motion is self.piston)
        self.boundary.remove(which, self.reached)
        self.world.prepare_bodies()
        self.solver.particles_moved()

    def add_opening(self, opening: Opening, gravity: Vec3) -> None:
        """Adds an inflow or outflow until the next reset. gravity [m/s^2]: for the potential energy
        of the water in its pipe. Raises FullError if there are too many or the method has none,
        ValueError if the opening is not inside the box or is in a body, or if a checkpoint cannot
        hold its speed."""
        if not isinstance(opening.speed, Valve | None):
            raise ValueError("needs a Valve as its speed")
        if not self.plan.method.HAS_OPENINGS:
            raise FullError("this method has no inflows and outflows")
        if len(self.openings.all) == MAX_OPENINGS:
            raise FullError(f"at most {MAX_OPENINGS} inflows and outflows")
        self._check_opening(opening)
        self.take_opening(opening)
        self.openings.fill_pipes([opening], gravity)
        self.solver.particles_added(0.0)

    def take_opening(self, opening: Opening) -> None:
        """Adds an inflow or outflow without checking it or filling its pipe."""
        self.world.load_openings(self.plan, [*self.openings.all, opening])

    @property
    def added_openings(self) -> list[Opening]:
        """Openings that the scene does not have."""
        return [o for o in self.openings.all if o not in self.plan.openings]

    def _check_opening(self, opening: Opening) -> None:
        spec = self.layers.specs[opening.layer]
        problem = opening.problem(self.walls, spec.spacing)
        if problem:
            raise ValueError(problem)
        # Tested half a spacing from the cross-section, inside the box if the opening is on a wall.
        inwards = 0.5 * spec.spacing * (1.0 if opening.enters else -1.0) * opening.along
        if not self.boundary.free(opening.centre + inwards + opening.sites(spec)[0]).all():
            raise ValueError("is inside a body")

    def remove_opening(self, opening: Opening) -> None:
        """Removes an inflow or outflow until the next reset; its wall closes."""
        self.world.load_openings(self.plan, [o for o in self.openings.all if o is not opening])
        self.solver.particles_moved()

    def measure_density(self) -> None:
        """Sums the densities at the current positions; a step sums them at its midpoint only."""
        if self.boundary.moving:
            self.boundary.place(self.reached, 0.0)
        self.grid.refresh()
        self.solver.measure_density()

    def _next_step(self, left: float, frame: float | None, external: ExternalForces) -> float:
        """Returns the length [s] of the next step, with `left` [s] to the end of the frame: an
        equal part of it, or, if the duration `frame` [s] is given, as long as allowed, at most a
        frame. Keeps the length of the last step while it is allowed and at most LENGTHENING_RATIO
        times too short."""
        longest, shorter = (
            self.solver.longest_step(k, external=external) for k in (1.0, LENGTHENING_RATIO)
        )
        if not shorter > 0.0:
            speed = np.linalg.norm(self.particles.numpy("v").astype(float), axis=1)
            which = self.particles.describe(int(np.argmax(speed)))
            raise BlowUpError(
                f"step {self.steps}: no step is short enough for the fastest particle, {which}"
            )
        if frame is not None:
            if longest >= frame:
                return left if left > 0.5 * frame else frame
            return self.last_step if shorter <= self.last_step <= longest else longest
        least, most = (math.ceil(left / bound - 1e-6) for bound in (longest, shorter))
        return left / min(max(least, round(left / self.last_step)), most)

    def counts(self) -> list[int]:
        """Returns the number of live particles of each layer."""
        return np.bincount(self.particles.numpy("layer"), minlength=self.layers.count).tolist()

    def state(self) -> dict[str, np.ndarray]:
        """Returns a checkpoint (checkpoint.py). On one thread a resumed run repeats an
        uninterrupted run exactly."""
        return checkpoint.state_of(self)

    def restore(self, state: dict[str, np.ndarray]) -> None:
        """Restores a state(). Raises ValueError if it does not fit this simulation."""
        checkpoint.restore(self, state)

    def mark(self) -> Mark:
        """Returns what undo() needs to restore the present state with all sums of the ledger."""
        boundary, rim = self.boundary, self.rim
        self.contact.push_bodies()
        received = boundary.impulse.copy(), boundary.twist.copy(), boundary.removed_impulse.copy()
        totals = self.world.parts.impulses.totals()
        return Mark(self.state(), totals, (rim.mass, rim.outflow), received)

    def undo(self, mark: Mark) -> None:
        """Restores the state of a mark()."""
        checkpoint.put_back(self, mark.state)
        self.world.parts.impulses.restore(mark.totals)
        self.rim.mass, self.rim.outflow = mark.left
        self.boundary.impulse, self.boundary.twist, self.boundary.removed_impulse = mark.received

    def start_from(
        self,
        attributes: dict[str, np.ndarray],
        time: float,
        steps: int,
        spilt: float = 0.0,
        ahead: float = 0.0,
    ) -> None:
        """Sets particles, time [s], number of steps, spilt mass [kg] and the time [s] by which the
        particles are ahead, with the bodies and openings of the scene at that time."""
        self.particles.fill(**attributes)
        self.time, self.ahead, self.steps, self.iterations = time, ahead, steps, 0
        self.last_step = math.inf
        if self.boundary.count > len(self.plan.bodies):
            self.world.load_bodies(self.plan)
        self.world.load_openings(self.plan, ())
        self.world.load_openings(self.plan, self.plan.openings)
        self.boundary.reset(self.reached)
        self.rim.reset(spilt)
        self.solver.reset()
