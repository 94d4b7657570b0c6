"""A fluid in its box, through time: particles, grid and solver under one roof."""

import math
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from time import perf_counter

import numpy as np

from msph.fluid.bodies import Body
from msph.fluid.forcing import Forcing
from msph.fluid.grid import LayeredGrid, grid_shape
from msph.fluid.layers import Layers, LayerSpec
from msph.fluid.methods import SOLVERS, Terms
from msph.fluid.neighbours import neighbours_provided
from msph.fluid.obstacles import Walls
from msph.fluid.particles import Particles

Stage = Callable[[str], AbstractContextManager]


# How much shorter than it might be a step may stay: pressures differ from one length to another, so
# that the first steps of a new length take three times the iterations.
LEEWAY = 1.1
# Bytes of an i32 or f32, the only numbers that fields hold.
WORD = 4


class NoWaterError(ValueError):
    """All the water was inside of bodies."""


def footprint(
    size: tuple[float, float, float], specs: list[LayerSpec], count: int, terms: Terms
) -> dict[str, int]:
    """Numbers (of WORD bytes) that `count` particles in a box of `size` [m] need, by purpose."""
    solver = SOLVERS[type(terms)]
    return {
        "cells": 2 * sum(math.prod(grid_shape(size, s.support)) for s in specs),
        "neighbours": (1 + solver.PER_ENTRY)
        * count
        * neighbours_provided(specs, solver.LIST_MARGIN, solver.reach(terms)),
        # Attributes, and place, cell, start and end of the sort and the list.
        "particles": count * (Particles.bytes_per_particle(solver.attributes(terms)) // WORD + 4),
    }


class Simulation:
    """The water of one scene.

    size [m] of the box, layer specs, initial attributes (x, v, layer as arrays), solver terms,
    bodies in the water or round it, and the most particles it may come to have, by default those it
    starts with. time [s] is simulated time; steps counts solver steps since the last reset,
    iterations those of their pressure solves; left_out counts initial particles dropped because
    they were inside a body. Raises NoWaterError where none remain.
    """

    def __init__(
        self,
        size: tuple[float, float, float],
        specs: list[LayerSpec],
        initial: dict[str, np.ndarray],
        terms: Terms,
        bodies: list[Body] | None = None,
        capacity: int | None = None,
    ):
        self.size = size
        self.layers = Layers(specs)
        solver = SOLVERS[type(terms)]
        self.walls = Walls(size, specs, bodies)
        free = self.walls.free(initial["x"])
        self.left_out = len(free) - int(free.sum())
        if not free.any():
            raise NoWaterError(f"all {len(free)} particles are inside bodies")
        initial = {name: values[free] for name, values in initial.items()}
        most = max(capacity or 0, len(initial["x"]))
        self.particles = Particles(most, solver.attributes(terms, self.walls.count > 0))
        self.grid = LayeredGrid(size, self.layers, self.particles)
        self.solver = solver(self.walls, self.layers, self.grid, self.particles, terms)
        self.initial = initial
        self.reset()

    def reset(self) -> None:
        """Back to the initial state at time zero."""
        self._start(dict(self.initial), 0.0, 0)
        self.solver.arrange()

    def advance(
        self,
        duration: float,
        forcing: Forcing,
        stage: Stage | None = None,
        budget: float | None = None,
        clock: Callable[[], float] = perf_counter,
    ) -> float:
        """Simulates `duration` [s] in steps no longer than the solver allows, and says how much.

        It is less only where `budget` [s] of wall-clock time did not suffice; one step is always
        done. Leaves the particles sorted into the grid, as the surface needs them. stage("bin"),
        stage("solve") are entered round the work of that name: a profiler's hook.
        """
        stage = stage or (lambda name: nullcontext())
        deadline = math.inf if budget is None else clock() + budget
        left = duration
        while left > 1e-6 * duration:
            dt = self.last_step = left / self._steps_to(left)
            with stage("bin"):
                self.solver.neighbours.refresh()
            with stage("solve"):
                if self.walls.moving:
                    self.walls.place(self.time + duration - left, dt)
                self.solver.step(dt, forcing)
            left -= dt
            self.steps += 1
            self.iterations += self.solver.iterations
            if clock() >= deadline:
                break
        with stage("bin"):
            self.grid.refresh()
        done = duration - left if left > 1e-6 * duration else duration
        self.time += done
        return done

    def _steps_to(self, left: float) -> int:
        """Even steps to the end of the frame, `left` [s] away, counted anew as the water's speed
        changes: as long as the last where that is allowed and not much too short."""
        longest = self.solver.longest_step
        least, most = (math.ceil(left / longest(k) - 1e-6) for k in (1.0, LEEWAY))
        return min(max(least, round(left / self.last_step)), most)

    def counts(self) -> list[int]:
        """Live particles of each layer."""
        return np.bincount(self.particles.numpy("layer"), minlength=self.layers.count).tolist()

    def state(self) -> dict[str, np.ndarray]:
        """A checkpoint: every carried attribute, the time, the steps taken and the length of the
        last, and whose it is."""
        progress = {
            "time": np.float64(self.time),
            "steps": np.int64(self.steps),
            "last_step": np.float64(self.last_step),
        }
        return {**progress, "fluid": self.fingerprint(), **self.particles.state()}

    def fingerprint(self) -> np.ndarray:
        """Box [m] and masses [kg] of the layers: what a checkpoint must share with the scene."""
        return np.array([*self.size, *(s.mass for s in self.layers.specs)])

    def restore(self, state: dict[str, np.ndarray]) -> None:
        """Goes on from a state(). Raises ValueError if it does not belong to this fluid."""
        attributes = dict(state)
        missing = {"time", "steps", "last_step", "fluid", *self.particles.state()} - set(attributes)
        if missing:
            raise ValueError(f"it lacks {', '.join(sorted(missing))}")
        time, steps, last_step = (attributes.pop(k) for k in ("time", "steps", "last_step"))
        fluid, own = attributes.pop("fluid"), self.fingerprint()
        if fluid.shape != own.shape or not np.allclose(fluid, own):
            raise ValueError("box or layers are not those of the scene")
        self.particles.check(attributes)
        x, layer = attributes["x"], attributes["layer"]
        if np.any(x < 0.0) or np.any(x > np.array(self.size, np.float32)):
            raise ValueError("it has particles outside the box")
        if layer.min() < 0 or layer.max() >= self.layers.count:
            raise ValueError(f"it has layers that are none of the scene's {self.layers.count}")
        if not last_step > 0.0:
            raise ValueError(f"its last step took {last_step:g} s")
        self._start(attributes, float(time), int(steps))
        self.last_step = float(last_step)

    def _start(self, attributes: dict[str, np.ndarray], time: float, steps: int) -> None:
        self.particles.fill(**attributes)
        self.time, self.steps, self.iterations = time, steps, 0
        self.last_step = math.inf
        self.walls.reset(time)
        self.solver.reset()
