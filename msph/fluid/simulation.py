"""The simulation of one scene: its state, its time and its steps."""

import math
import weakref
from collections.abc import Callable
from time import perf_counter

import numpy as np

from msph.errors import BlowUpError
from msph.fluid.external_forces import ExternalForces
from msph.fluid.methods import Parameters, all_attributes, solver_of
from msph.fluid.particles.grid import cells_of
from msph.fluid.particles.layers import LayerSpec
from msph.fluid.particles.neighbour_list import list_capacity
from msph.fluid.particles.particles import Particles
from msph.fluid.plan import Plan
from msph.fluid.room import FIRST, grown
from msph.fluid.stages import Stage, no_stage
from msph.fluid.trapped_water import check_trapped_water
from msph.fluid.world import give_back, take

# Factor (-) by which a step may stay shorter than allowed before it is lengthened: the first steps
# of a new length take three times the iterations, since pressures depend on it.
LENGTHENING_RATIO = 1.1
# Bytes of an i32 or f32, the only numbers that fields hold.
WORD = 4


class NoWaterError(ValueError):
    """All the water was inside of bodies."""


def footprint(
    size: tuple[float, float, float],
    specs: list[LayerSpec],
    count: int,
    parameters: Parameters,
) -> dict[str, int]:
    """Numbers (of WORD bytes) that are allocated for `count` particles in a box of `size` [m], by
    purpose, on a GPU; lists of neighbours are smaller on a CPU."""
    solver = solver_of(parameters)
    entries = list_capacity(specs, solver.LIST_MARGIN, solver.list_form(parameters), count)
    # Attributes, and place, cell, start and end of the sort and the list.
    each = Particles.bytes_per_particle(all_attributes()) // WORD + 4
    return {
        "cells": 2 * grown(FIRST.cells, sum(cells_of(size, specs))),
        "neighbours": (1 + solver.PER_ENTRY) * grown(FIRST.entries, entries),
        "particles": each * grown(FIRST.particles, count),
    }


class Simulation:
    """Simulation of one scene, as a Plan describes it.

    time [s] is simulated time; steps counts solver steps since the last reset, iterations those of
    their pressure solves; left_out counts initial particles dropped because they were inside a
    body, mass_left_out [kg] is theirs. Raises NoWaterError where none remain. close() gives the
    fields back for the next simulation.
    """

    def __init__(self, plan: Plan):
        self.plan, self.size = plan, plan.size
        self.world = take(plan.needed)
        self._lease = weakref.finalize(self, give_back, self.world)
        parts = self.world.parts
        self.layers, self.particles, self.grid = parts.layers, parts.particles, parts.grid
        self.boundary, self.contact = parts.boundary, parts.contact
        self.solver = self.world.load(plan)
        free = self.boundary.free(plan.initial["x"])
        self.left_out = len(free) - int(free.sum())
        masses = np.array([s.mass for s in plan.specs])
        self.mass_left_out = float(masses[plan.initial["layer"][~free]].sum())
        if not free.any():
            self.close()
            raise NoWaterError(f"all {len(free)} particles are inside bodies")
        self.initial = {name: values[free] for name, values in plan.initial.items()}
        self.particles.capacity = max(plan.capacity or 0, int(free.sum()))
        self.reset()

    def close(self) -> None:
        """Gives the fields back; nothing can be done with the simulation afterwards."""
        self._lease()

    def reset(self) -> None:
        """Back to the initial state at time zero."""
        self._start(dict(self.initial), 0.0, 0)
        self.solver.arrange()

    def warm_up(self, duration: float) -> None:
        """Compiles every kernel by a frame of `duration` [s], and starts anew."""
        self.advance(duration, ExternalForces())
        self.measure_density()
        self.reset()

    def advance(
        self,
        duration: float,
        external: ExternalForces,
        stage: Stage = no_stage,
        budget: float | None = None,
        clock: Callable[[], float] = perf_counter,
        on_progress: Callable[[float], None] | None = None,
    ) -> float:
        """Simulates `duration` [s] in steps no longer than the solver allows; returns the time [s]
        simulated.

        It is less than `duration` only where `budget` [s] of wall-clock time did not suffice; one
        step is always made. Leaves the particles sorted into the grid, as the surface needs them.
        stage(name) is entered round each part of a step, as a profiler's hook; on_progress is called
        after each step with the share (0 to 1) of the duration that is over. Raises
        TrappedWaterError where a moving body leaves the water no room, BlowUpError where
        speeds or pressures have grown beyond any step.
        """
        deadline = math.inf if budget is None else clock() + budget
        left = duration
        while left > 1e-6 * duration:
            if self.boundary.moving:
                now, longest = self.time + duration - left, self.solver.longest_step()
                check_trapped_water(
                    self.boundary, self.layers, self.particles, external, longest, now
                )
            dt = self.last_step = left / self._step_count(left)
            self.solver.step(dt, external, stage)
            left -= dt
            self.steps += 1
            self.iterations += self.solver.iterations
            if on_progress:
                on_progress(1.0 - left / duration)
            if clock() >= deadline:
                break
        with stage("neighbours"):
            self.grid.refresh()
        done = duration - left if left > 1e-6 * duration else duration
        self.time += done
        return done

    def measure_density(self, stage: Stage = no_stage) -> None:
        """Sums the densities at the present positions; a step sums them in its middle only.

        stage(name) is entered round each part, as in advance().
        """
        if self.boundary.moving:
            self.boundary.place(self.time, 0.0)
        with stage("neighbours"):
            self.grid.refresh()
        self.solver.measure_density(stage)

    def _step_count(self, left: float) -> int:
        """Number of equal steps to the end of the frame, `left` [s] away. Their length is that of
        the last step while that is allowed and at most LENGTHENING_RATIO times too short."""
        longest = self.solver.longest_step
        if longest(LENGTHENING_RATIO) <= 0.0:
            speed = np.linalg.norm(self.particles.numpy("v").astype(float), axis=1)
            which = self.particles.describe(int(np.argmax(speed)))
            raise BlowUpError(
                f"step {self.steps}: no step is short enough for the fastest, {which}"
            )
        least, most = (math.ceil(left / longest(k) - 1e-6) for k in (1.0, LENGTHENING_RATIO))
        return min(max(least, round(left / self.last_step)), most)

    def counts(self) -> list[int]:
        """Live particles of each layer."""
        return np.bincount(self.particles.numpy("layer"), minlength=self.layers.count).tolist()

    def state(self) -> dict[str, np.ndarray]:
        """A checkpoint: every carried attribute, the time, the number of steps and the length of
        the last, the solver's own state, and the fingerprint of the fluid. On one thread a run
        resumed from it is bit for bit the run that was never stopped."""
        progress = {
            "time": np.float64(self.time),
            "steps": np.int64(self.steps),
            "last_step": np.float64(self.last_step),
        }
        solver = {f"solver.{k}": np.float64(v) for k, v in self.solver.state().items()}
        return {**progress, **solver, "fluid": self.fingerprint(), **self.particles.state()}

    def fingerprint(self) -> np.ndarray:
        """Box [m] and masses [kg] of the layers: what a checkpoint must share with the scene."""
        return np.array([*self.size, *(s.mass for s in self.layers.specs)])

    def restore(self, state: dict[str, np.ndarray]) -> None:
        """Goes on from a state(). Raises ValueError if it does not belong to this fluid."""
        attributes = dict(state)
        missing = set(self.state()) - set(attributes)
        if missing:
            raise ValueError(f"it lacks {', '.join(sorted(missing))}")
        time, steps, last_step = (attributes.pop(k) for k in ("time", "steps", "last_step"))
        fluid, own = attributes.pop("fluid"), self.fingerprint()
        solver = {k: float(attributes.pop(f"solver.{k}")) for k in self.solver.state()}
        if fluid.shape != own.shape or not np.allclose(fluid, own):
            raise ValueError("box or layers are not those of the scene")
        self.particles.check(attributes)
        x, layer = attributes["x"], attributes["layer"]
        if np.any(x < 0.0) or np.any(x > np.array(self.size, np.float32)):
            raise ValueError("it has particles outside the box")
        if layer.min() < 0 or layer.max() >= self.layers.count:
            raise ValueError(f"it has layers that are none of the scene's {self.layers.count}")
        if not 0.0 <= time < math.inf:
            raise ValueError(f"its time is {time:g} s")
        if not last_step > 0.0:
            raise ValueError(f"its last step took {last_step:g} s")
        self._start(attributes, float(time), int(steps))
        self.last_step = float(last_step)
        self.solver.restore(solver)

    def _start(self, attributes: dict[str, np.ndarray], time: float, steps: int) -> None:
        self.particles.fill(**attributes)
        self.time, self.steps, self.iterations = time, steps, 0
        self.last_step = math.inf
        self.boundary.reset(time)
        self.solver.reset()
