"""A picked particle: its neighbours by kernel weight, its values and its accelerations."""

from typing import Any

import numpy as np
import taichi as ti

from msph.device_table import DeviceTable, f32
from msph.fluid.particles import kernels
from msph.fluid.particles.layers import MAX_LAYERS
from msph.fluid.particles.neighbour_list import LIST_FORMS
from msph.launches import data_oriented, kernel
from msph.state import State

# Displayed radius over the particle's, of non-neighbours and of neighbours with weight 0; both are
# small, so that neighbours with larger weights stay visible.
DOT, SHELL = 0.2, 0.35
# Weight of the previous mean in smoothed accelerations; single steps fluctuate.
SMOOTHING = 0.8


@data_oriented
class NeighbourWeights:
    """Kernel weights of one particle at all others."""

    def __init__(self, state: State):
        self.particles, self.layers = state.particles, state.layers
        self._pairs = DeviceTable((MAX_LAYERS, MAX_LAYERS), reach=f32)  # [m]
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
        """Computes value (n,) = W_ij / W(0), and scales radius (n,) [m] by DOT for particles that
        are no neighbours, and by SHELL to 1 with the weight for neighbours."""
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
    """The picked particle. id: its identity, None if no particle is picked."""

    def __init__(self, state: State):
        self.state = state
        self.particles, self.layers = state.particles, state.layers
        h = np.array([s.support for s in self.layers.specs])
        reach: Any = LIST_FORMS[state.plan.list_form]
        self.reaches = reach(h[:, None], h[None])  # [m], by the layers of a pair
        self.id: int | None = None
        self.before: Any = None  # time [s] and velocity [m/s] in the previous frame
        self.acceleration: Any = None  # (3,) [m/s^2], smoothed
        self.index = 0

    def pick(self, index: int | None) -> None:
        """Picks the particle with this index, or no particle."""
        self.id = None
        if index is not None:
            self.state.build_once(NeighbourWeights).load(reach=self.reaches)
            self.id = int(self.particles.numpy("id")[index])
        self.before = self.acceleration = None

    def find(self) -> bool:
        """Finds the index of the particle; returns False if there is no such particle."""
        if self.id is None:
            return False
        places = np.flatnonzero(self.particles.numpy("id") == self.id)
        if len(places) == 0:
            self.pick(None)
            return False
        self.index = int(places[0])
        return True

    def follow(self) -> None:
        """Updates the particle's smoothed acceleration after a frame."""
        if not self.find():
            return
        time = self.state.now.time
        velocity = self.particles.numpy("v")[self.index].astype(float)
        if self.before is not None and time > self.before[0]:
            now = (velocity - self.before[1]) / (time - self.before[0])
            old = now if self.acceleration is None else self.acceleration
            self.acceleration = SMOOTHING * old + (1.0 - SMOOTHING) * now
        self.before = time, velocity

    def weigh(self, value: ti.Field, radius: ti.Field) -> None:
        """Computes the weights (n,) and scales the radii (n,) [m]; see NeighbourWeights."""
        weights = self.state.build_once(NeighbourWeights)
        classic = self.state.plan.method.NAME == "classic"
        weights.weigh(self.index, self.particles.count, classic, value, radius)

    def facts(self) -> list[str]:
        """Returns lines with the particle's values, its density summed at the current positions.
        Mirror images count as no neighbours. Requires find() to have returned True."""
        i, p = self.index, self.particles
        layer = int(p.numpy("layer")[i])
        x, layers = p.numpy("x"), p.numpy("layer")
        near = int((np.linalg.norm(x - x[i], axis=1) < self.reaches[layer, layers]).sum()) - 1
        h, rest = 1e3 * self.reaches[layer, layer], self.layers.finest.density
        lines = [f"particle {self.id}, layer {layer}: {near} neighbours within {h:.3g} mm"]
        if self.state.now.picked:
            density, pressure = self.state.now.picked
            lines.append(
                f"density {100.0 * (density / rest - 1.0):+.2f} %, pressure {pressure:.0f} Pa, "
                f"speed {np.linalg.norm(p.numpy('v')[i]):.2f} m/s"
            )
        if self.acceleration is not None:
            lines.append(f"total acceleration {np.linalg.norm(self.acceleration):.2f} m/s^2")
        return lines

    def arrows(self, gravity: np.ndarray) -> dict[str, np.ndarray]:
        """Returns the accelerations (3,) [m/s^2] by name; gravity (3,) in the box frame. "water"
        is the total less gravity, caused by the neighbours, walls and the hand."""
        if self.acceleration is None:
            return {}
        return {"gravity": gravity, "water": self.acceleration - gravity}

    def place(self) -> np.ndarray:
        """Returns the particle's position, (3,) [m]."""
        return self.particles.numpy("x")[self.index].astype(float)
