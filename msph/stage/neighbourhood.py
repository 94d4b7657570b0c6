"""One particle of a view, its neighbours by the weight of its kernel, and what acts on it."""

from typing import Any

import numpy as np
import taichi as ti

from msph.device_table import DeviceTable, f32
from msph.fluid.particles import kernels
from msph.fluid.particles.layers import MOST_LAYERS
from msph.fluid.particles.neighbour_list import REACHES
from msph.fluid.simulation import Simulation
from msph.fluid.world import World
from msph.picture.legend import Legend
from msph.taichi_internals import data_oriented, kernel

# Radius of particles that are no neighbours, over their own: they are dots. And of neighbours of no
# weight: smaller than those of more, which would else be hidden within.
DOT, SHELL = 0.2, 0.35
# Weight of the past in accelerations: those of single steps jump.
SMOOTHING = 0.8


@data_oriented
class NeighbourWeights:
    """Weights of the kernel of one particle at all others."""

    def __init__(self, world: World):
        self.particles, self.layers = world.parts.particles, world.parts.layers
        self._pairs = DeviceTable((MOST_LAYERS, MOST_LAYERS), reach=f32)  # [m]
        self.reach, self.load = self._pairs.reach, self._pairs.fill

    @kernel
    def weigh(
        self,
        i: ti.i32,
        n: ti.i32,
        classic: ti.template(),
        value: ti.template(),
        radius: ti.template(),
    ):
        """value (n,): W_ij over W(0); radius (n,) [m] of what is no neighbour shrinks."""
        for j in range(n):
            layer, other = self.particles.layer[i], self.particles.layer[j]
            h = self.reach[layer, other]
            r, w = (self.particles.x[j] - self.particles.x[i]).norm(), 0.0
            if ti.static(classic):
                w = kernels.poly6(r, h) / kernels.poly6(0.0, h)
                if self.layers.wendland[layer] == 1:
                    w = kernels.wendland(r, h) / kernels.wendland(0.0, h)
            else:
                w = kernels.quartic(r, h) / kernels.quartic(0.0, h)
            value[j] = w
            radius[j] *= DOT if r >= h else ti.math.mix(SHELL, 1.0, w)


class Neighbourhood:
    """id: of the particle that was picked, None while none is."""

    def __init__(self, simulation: Simulation):
        self.simulation = simulation
        self.particles, self.layers = simulation.particles, simulation.layers
        solver, h = simulation.solver, np.array([s.support for s in self.layers.specs])
        reach: Any = REACHES[solver.reach(solver.parameters)]
        self.reaches = reach(h[:, None], h[None])  # [m], by the layers of a pair
        self.id: int | None = None
        self.before: Any = None  # time [s] and velocity [m/s] of the frame before
        self.acceleration: Any = None  # (3,) [m/s^2], smoothed
        self.index = 0

    def pick(self, index: int | None) -> None:
        """Takes the particle at that place of the pool, or none."""
        self.id = None
        if index is not None:
            self.simulation.world.once(NeighbourWeights).load(reach=self.reaches)
            self.id = int(self.particles.numpy("id")[index])
        self.before = self.acceleration = None

    def find(self) -> bool:
        """Whether the particle is still there: merges take particles away. Sets `index`."""
        if self.id is None:
            return False
        places = np.flatnonzero(self.particles.numpy("id") == self.id)
        if len(places) == 0:
            self.pick(None)
            return False
        self.index = int(places[0])
        return True

    def follow(self) -> None:
        """Takes in a frame: how the particle was accelerated in it."""
        if not self.find():
            return
        time = self.simulation.time
        velocity = self.particles.numpy("v")[self.index].astype(float)
        if self.before is not None and time > self.before[0]:
            now = (velocity - self.before[1]) / (time - self.before[0])
            old = now if self.acceleration is None else self.acceleration
            self.acceleration = SMOOTHING * old + (1.0 - SMOOTHING) * now
        self.before = time, velocity

    def weigh(self, value: ti.Field, radius: ti.Field) -> None:
        """value (n,): W_ij over W(0); radius (n,) [m] of what is no neighbour shrinks."""
        weights = self.simulation.world.once(NeighbourWeights)
        classic = self.simulation.solver.NAME == "classic"
        weights.weigh(self.index, self.particles.count, classic, value, radius)

    def legend(self) -> Legend:
        return Legend("kernel W(r)/W(0) [-]", ((0.0, "0"), (0.5, "0.5"), (1.0, "1")))

    def facts(self) -> list[str]:
        """What is known of the particle, a line each, its density summed over the positions as they
        are; images behind walls are no particles. find() must have found it."""
        self.simulation.measure_density()
        # Measuring sorts the particles.
        self.find()
        i, p = self.index, self.particles
        layer = int(p.numpy("layer")[i])
        x, layers = p.numpy("x"), p.numpy("layer")
        near = int((np.linalg.norm(x - x[i], axis=1) < self.reaches[layer, layers]).sum()) - 1
        h = 1e3 * self.reaches[layer, layer]
        lines = [
            f"particle {self.id}, layer {layer}: {near} neighbours within {h:.3g} mm",
            f"density {100.0 * (p.numpy('density')[i] / self._rest() - 1.0):+.2f} %, "
            f"pressure {p.numpy('pressure')[i]:.0f} Pa, "
            f"speed {np.linalg.norm(p.numpy('v')[i]):.2f} m/s",
        ]
        if self.acceleration is not None:
            lines.append(f"accelerated by {np.linalg.norm(self.acceleration):.2f} m/s^2 in all")
        return lines

    def arrows(self, gravity: np.ndarray) -> dict[str, np.ndarray]:
        """Accelerations (3,) [m/s^2] that act, by name; gravity (3,) in the box's frame. What
        gravity does not explain is the neighbours' doing, or the hand's."""
        if self.acceleration is None:
            return {}
        return {"gravity": gravity, "water": self.acceleration - gravity}

    def place(self) -> np.ndarray:
        """Of the particle, (3,) [m]."""
        return self.particles.numpy("x")[self.index].astype(float)

    def _rest(self) -> float:
        return self.simulation.layers.finest.density
