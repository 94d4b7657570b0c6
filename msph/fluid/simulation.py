"""A fluid in its box, through time: particles, grid and solver under one roof."""

import math
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext

import numpy as np

from msph.fluid.forcing import Forcing
from msph.fluid.grid import LayeredGrid, grid_shape
from msph.fluid.layers import Layers, LayerSpec
from msph.fluid.methods import SOLVERS, Terms
from msph.fluid.neighbours import neighbours_provided
from msph.fluid.particles import Particles

Stage = Callable[[str], AbstractContextManager]


def bytes_needed(
    size: tuple[float, float, float], specs: list[LayerSpec], count: int, terms: Terms
) -> int:
    """Device memory [bytes] for `count` particles in a box of the given size [m]."""
    solver = SOLVERS[type(terms)]
    cells = sum(math.prod(grid_shape(size, s.support)) for s in specs)
    listed = count * neighbours_provided(specs, solver.LIST_MARGIN, solver.reach(terms))
    per_particle = Particles.bytes_per_particle(solver.attributes) + 4 * 4
    return 8 * cells + 8 * listed + per_particle * count


class Simulation:
    """The water of one scene.

    size [m] of the box, layer specs, initial attributes (x, v, layer as arrays), solver terms.
    time [s] is simulated time; steps counts solver steps since the last reset.
    """

    def __init__(
        self,
        size: tuple[float, float, float],
        specs: list[LayerSpec],
        initial: dict[str, np.ndarray],
        terms: Terms,
    ):
        self.size = size
        self.layers = Layers(specs)
        solver = SOLVERS[type(terms)]
        self.particles = Particles(len(initial["x"]), solver.attributes)
        self.grid = LayeredGrid(size, self.layers, self.particles)
        self.solver = solver(size, self.layers, self.grid, self.particles, terms)
        self.initial = initial
        self.reset()

    def reset(self) -> None:
        """Back to the initial state at time zero."""
        self.restore({"time": np.float64(0.0), "steps": np.int64(0), **self.initial})

    def advance(self, duration: float, forcing: Forcing, stage: Stage | None = None) -> None:
        """Simulates `duration` [s] in steps no longer than the solver allows.

        Leaves the particles sorted into the grid, as the surface needs them. stage("bin"),
        stage("solve") are entered round the work of that name: a profiler's hook.
        """
        stage = stage or (lambda name: nullcontext())
        left = duration
        while left > 1e-6 * duration:
            # Even steps to the end of the frame, counted anew as the water's speed changes.
            dt = left / math.ceil(left / self.solver.longest_step() - 1e-6)
            with stage("bin"):
                self.solver.find_neighbours()
            with stage("solve"):
                self.solver.step(dt, forcing)
            left -= dt
            self.steps += 1
        with stage("bin"):
            self.solver.bin()
        self.time += duration

    def counts(self) -> list[int]:
        """Live particles of each layer."""
        return np.bincount(self.particles.numpy("layer"), minlength=self.layers.count).tolist()

    def state(self) -> dict[str, np.ndarray]:
        """A checkpoint: every carried attribute, the time and the step count."""
        progress = {"time": np.float64(self.time), "steps": np.int64(self.steps)}
        return {**progress, **self.particles.state()}

    def restore(self, state: dict[str, np.ndarray]) -> None:
        """Goes on from a state(). Raises ValueError if it does not belong to this scene."""
        attributes = dict(state)
        time, steps = float(attributes.pop("time")), int(attributes.pop("steps"))
        unknown = set(attributes) - set(self.particles.attributes)
        if unknown:
            raise ValueError(f"unknown attributes: {', '.join(sorted(unknown))}")
        if attributes["layer"].max(initial=0) >= self.layers.count:
            raise ValueError(f"it has layers beyond the scene's {self.layers.count}")
        self.particles.fill(**attributes)
        self.time, self.steps = time, steps
        self.solver.reset()
