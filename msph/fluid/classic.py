"""Classic method: the weakly compressible multi-layer SPH of Gokdogan's thesis (2008, ch. 3, A.2).

Densities and forces sum over all layers, each neighbour j with its own mass m_j and support h_j.
Equation numbers are those of the thesis.
"""

import math
from typing import Any

import numpy as np
import taichi as ti

from msph.fluid.classic_parameters import ClassicParameters
from msph.fluid.external_forces import (
    FIELD_NUMBERS,
    HAND_NUMBERS,
    NO_HAND,
    ExternalForces,
    coriolis,
    field_at,
    hand_acceleration,
    turning,
)
from msph.fluid.part import Part, Parts
from msph.fluid.particles import kernels
from msph.fluid.particles.layers import LayerSpec
from msph.fluid.particles.particles import Attribute
from msph.fluid.stages import Stage, no_stage
from msph.launches import data_oriented, kernel

# Explicit viscosity is stable while dt < VISCOUS_NUMBER h^2 rho / mu (Morris et al. 1997, eq. 19).
VISCOUS_NUMBER = 0.125

ATTRIBUTES = (
    Attribute("density", "kg/m^3", "density by eq. 26", view="density_error"),
    Attribute("pressure", "Pa", "pressure by eq. 15", view="pressure"),
    Attribute("acceleration", "m/s^2", "by the other particles", width=3, carried=False),
)


@data_oriented
class Classic(Part):
    """Solver of the classic method; with a single layer it is the SPH of Mueller et al. (2003).

    The class attributes are explained in docs/extending.md, "A solver".
    """

    NAME = "classic"
    PARAMETERS = ClassicParameters
    ADAPTS, HAS_BODIES, HAS_OPENINGS = False, False, False
    LAYER_OPTIONS = ("gravity_factor", "viscosity", "kernels")
    SMOOTHING, MIN_SMOOTHING = 2.0, 1.2  # the thesis gives no values
    # Wider lists are searched less often, but are longer.
    LIST_MARGIN = 0.5
    PER_ENTRY = 0

    parameters: ClassicParameters

    @staticmethod
    def attributes(parameters: ClassicParameters | None, adaptive: bool) -> tuple[Attribute, ...]:
        """Returns the attributes beyond the core."""
        return ATTRIBUTES

    def __init__(self, parts: Parts):
        super().__init__(parts)
        self.farthest = ti.field(ti.f32, shape=())  # longest motion of a particle in a step [m]
        self.iterations = 0  # explicit: no system is solved

    def load(self, parameters: ClassicParameters, adaptation: None) -> None:
        """Takes the parameters of a scene whose tables and constants are filled already."""
        self.parameters = parameters
        self.own_kernels = any(s.wendland for s in self.layers.specs)
        # True for layers that have the scene's common viscosity, also after it changes.
        self.common_viscosity = np.array(
            [s.viscosity == parameters.viscosity for s in self.layers.specs]
        )

    @staticmethod
    def constants_of(
        parameters: ClassicParameters, adaptation: None, specs: list[LayerSpec]
    ) -> dict[str, Any]:
        """Returns no constants: this method has none of its own."""
        return {}

    @staticmethod
    def tables_of(adaptation: None, specs: list[LayerSpec]) -> tuple[dict, dict]:
        """Returns no columns: this method has none of its own."""
        return {}, {}

    @staticmethod
    def list_form(parameters: ClassicParameters) -> str:
        """Returns the form of the neighbour list; symmetrised pressures need both supports."""
        return "scatter" if parameters.pressure_form == "mean" else "widest"

    def arrange(self) -> None:
        """Does nothing: particles start where the scene places them, as in the thesis."""

    def longest_step(self, safety: float = 1.0, external: ExternalForces = NO_HAND) -> float:
        """Returns the largest stable time step [s]: the least of step_bounds()."""
        return min(self.step_bounds(safety, external).values())

    def step_bounds(
        self, safety: float = 1.0, external: ExternalForces = NO_HAND
    ) -> dict[str, float]:
        """Returns the bounds of the time step [s] by the parameter that sets them: in one step
        sound crosses courant * h, and viscosity diffuses within h. The arguments are unused, since
        motion does not bound the step."""
        c, specs = self.parameters.stiffness**0.5, self.layers.specs
        bounds = {"stiffness": self.parameters.courant * min(s.support for s in specs) / c}
        diffusion = [
            VISCOUS_NUMBER * s.support**2 * s.density / mu
            for s, mu in zip(specs, self._viscosities(), strict=True)
            if mu > 0.0
        ]
        return bounds | ({"viscosity": min(diffusion)} if diffusion else {})

    def tune(self, parameters: ClassicParameters) -> None:
        """Updates the live parameters (msph.parameter)."""
        self.parameters = parameters
        for layer, viscosity in enumerate(self._viscosities()):
            self.layers.viscosity[layer] = viscosity

    def _viscosities(self) -> np.ndarray:
        """Returns the dynamic viscosity [Pa s] of each layer."""
        own = np.array([s.viscosity for s in self.layers.specs])
        return np.where(self.common_viscosity, self.parameters.viscosity, own)

    def reset(self) -> None:
        """Clears all state that belongs to particles which have been replaced."""
        self.impulses.clear()
        self.grid.invalidate()
        self.grid.refresh()

    def particles_added(self, speed: float) -> None:
        """Accounts for new particles; speeds do not bound the step."""
        self.neighbours.moved(math.inf)
        self.grid.invalidate()
        self.grid.refresh()

    def step(self, dt: float, external: ExternalForces, stage: Stage = no_stage) -> None:
        """Advances by dt [s] as in A.2: grid, densities, pressures, forces, positions, walls."""
        self.find_accelerations(stage)
        with stage("drift"):
            numbers = external.inertial_field(), external.hand.numbers()
            self.move(self.particles.count, dt, external.gravity, *numbers)
            self.neighbours.moved(self.farthest[None])
            self.grid.invalidate()

    def find_accelerations(self, stage: Stage = no_stage) -> None:
        """Computes densities, pressures and the accelerations by other particles."""
        n, p = self.particles.count, self.parameters
        self.measure_density(stage)
        with stage("forces"):
            symmetric, squared = p.pressure_form != "mean", p.pressure_form == "squared"
            self.find_forces(n, symmetric, squared, p.viscosity_form == "formula", self.own_kernels)
            if p.attraction > 0.0:
                self.attract(n, p.attraction, p.colour_threshold)

    def measure_density(self, stage: Stage = no_stage) -> None:
        """Computes densities and pressures at the particles' current positions."""
        with stage("neighbours"):
            self.neighbours.refresh()
        with stage("density"):
            n, p = self.particles.count, self.parameters
            self.find_densities(n, p.stiffness, p.tension, self.own_kernels)

    def state(self) -> dict[str, float]:
        """Returns no numbers: a checkpoint holds the particles only."""
        return {}

    def restore(self, state: dict[str, float]) -> None:
        """Does nothing; see state()."""

    @kernel
    def find_densities(
        self, n: ti.i32, stiffness: ti.f32, tension: ti.template(), own_kernels: ti.template()
    ):
        """rho_i = sum_j m_j W(r_ij, h_j) (26) [kg/m^3]; p_i = k (rho_i - rho0) (15) [Pa]."""
        for i in range(n):
            layer = self.particles.layer[i]
            peak = self._density_kernel(0.0, self.layers.support[layer], layer, own_kernels)
            rho = self.layers.mass[layer] * peak
            for s in range(self.neighbours.start[i], self.neighbours.end[i]):
                j = self.neighbours.index[s]
                other = self.particles.layer[j]
                r = (self.particles.x[i] - self.particles.x[j]).norm()
                w = self._density_kernel(r, self.layers.support[other], other, own_kernels)
                rho += self.layers.mass[other] * w
            p = stiffness * (rho - self.constants.rest_density[None])
            if ti.static(not tension):
                p = ti.max(p, 0.0)
            self.particles.density[i] = rho
            self.particles.pressure[i] = p

    @kernel
    def find_forces(
        self,
        n: ti.i32,
        symmetric: ti.template(),
        squared: ti.template(),
        formula: ti.template(),
        own_kernels: ti.template(),
    ):
        """a_i = (f_pressure + f_viscosity) / rho_i [m/s^2] by (27) and (28). symmetric: (33), with
        squared (32), in place of (27); formula: (28) in place of the pseudo-code."""
        for i in range(n):
            a = ti.Vector([0.0, 0.0, 0.0])
            for s in range(self.neighbours.start[i], self.neighbours.end[i]):
                j = self.neighbours.index[s]
                self._add_forces(i, j, a, symmetric, squared, formula, own_kernels)
            self.particles.acceleration[i] = a

    @kernel
    def attract(self, n: ti.i32, attraction: ti.f32, threshold: ti.f32):
        """a_i -= sigma lap(c) n/|n| / rho_i [m/s^2], n = grad c of the colour c = sum m_j/rho_j W,
        where |n| h exceeds the threshold."""
        for i in range(n):
            layer = self.particles.layer[i]
            h = self.layers.support[layer]
            share = self.layers.mass[layer] / self.particles.density[i]
            colour = ti.Vector([0.0, 0.0, 0.0, share * kernels.poly6_laplacian(0.0, h)])
            for s in range(self.neighbours.start[i], self.neighbours.end[i]):
                self._add_colour(i, self.neighbours.index[s], colour)
            normal = colour.xyz
            length = normal.norm()
            if length * h > threshold:
                strength = attraction * colour.w / self.particles.density[i]
                self.particles.acceleration[i] -= strength * normal / length

    @kernel
    def move(
        self,
        n: ti.i32,
        dt: ti.f32,
        gravity: ti.math.vec3,
        inertia_numbers: FIELD_NUMBERS,
        hand_numbers: HAND_NUMBERS,
    ):
        """Position Verlet x' = 2 x - x_old + dt^2 a, v = (x - x_old)/dt, then reflecting walls.

        The form x' = x + dt (v + dt a) loses no digits in single precision and allows dt to change.
        Particles stop half a spacing from the walls. The internal impulse sum m a dt [N s] is zero
        only for antisymmetric pair forces.
        """
        self.farthest[None] = 0.0
        for i in range(n):
            layer = self.particles.layer[i]
            x, v = self.particles.x[i], self.particles.v[i]
            a = self.particles.acceleration[i]
            m = self.layers.mass[layer]
            self.impulses.record_internal(i, m, x, dt * a)
            a += gravity * self.layers.gravity_factor[layer]
            inertia = field_at(x - 0.5 * self.constants.size[None], inertia_numbers)
            user = hand_acceleration(x, v, dt, hand_numbers)
            turned = coriolis(v, dt, turning(inertia_numbers))
            a += inertia + turned
            self.impulses.record_user(i, m, v, dt, user, a)
            self.impulses.inertia_impulse.add(i, m * dt * (inertia + turned))
            v += dt * (a + user)
            start, free = x, v
            x += dt * v
            margin, restitution = 0.5 * self.layers.spacing[layer], self.constants.restitution[None]
            wall = self.walls.confined(start, x, margin)
            for k in ti.static(range(3)):
                if x[k] != wall[k]:
                    v[k] = -restitution * v[k]
            # A reflected position passes the opposite wall only in a box of a few particles.
            x = self.walls.confined(start, wall + restitution * (wall - x), margin)
            self.impulses.wall_impulse.add(i, m * (v - free))
            self.impulses.inertia_work.add(i, m * inertia.dot(x - start))
            self.particles.x[i] = x
            self.particles.v[i] = v
            ti.atomic_max(self.farthest[None], (x - start).norm())

    @ti.func
    def _density_kernel(self, r, h, layer, own_kernels: ti.template()):
        w = kernels.poly6(r, h)
        if ti.static(own_kernels):
            if self.layers.wendland[layer] == 1:
                w = kernels.wendland(r, h)
        return w

    @ti.func
    def _pressure_slope(self, r, h, layer, own_kernels: ti.template()):
        slope = kernels.spiky_slope(r, h)
        if ti.static(own_kernels):
            if self.layers.wendland[layer] == 1:
                slope = kernels.wendland_slope(r, h)
        return slope

    @ti.func
    def _add_forces(
        self,
        i,
        j,
        a: ti.template(),
        symmetric: ti.template(),
        squared: ti.template(),
        formula: ti.template(),
        own_kernels: ti.template(),
    ):
        l_i, l_j = self.particles.layer[i], self.particles.layer[j]
        m, h = self.layers.mass[l_j], self.layers.support[l_j]
        r_ij = self.particles.x[i] - self.particles.x[j]
        r = r_ij.norm()
        rho_i, rho_j = self.particles.density[i], self.particles.density[j]
        p_i, p_j = self.particles.pressure[i], self.particles.pressure[j]
        slope = self._pressure_slope(r, h, l_j, own_kernels)
        push = 0.0
        if ti.static(symmetric):
            other = self._pressure_slope(r, self.layers.support[l_i], l_i, own_kernels)
            slope = 0.5 * (slope + other)
        if ti.static(squared):
            push = p_i / rho_i**2 + p_j / rho_j**2
        else:
            push = (p_i + p_j) / (2.0 * rho_i * rho_j)
        a -= m * push * slope * r_ij / ti.max(r, 1e-6 * h)
        drag = m * kernels.viscosity_laplacian(r, h)
        if ti.static(formula):
            drag *= self.layers.viscosity[l_i] / (rho_i * rho_j)
        else:
            drag *= (self.layers.viscosity[l_i] + self.layers.viscosity[l_j]) / (2.0 * rho_i**2)
        a += drag * (self.particles.v[j] - self.particles.v[i])

    @ti.func
    def _add_colour(self, i, j, colour: ti.template()):
        layer = self.particles.layer[j]
        h = self.layers.support[layer]
        r_ij = self.particles.x[i] - self.particles.x[j]
        r = r_ij.norm()
        share = self.layers.mass[layer] / self.particles.density[j]
        n = share * kernels.poly6_slope(r, h) * r_ij / ti.max(r, 1e-6 * h)
        colour += ti.Vector([n[0], n[1], n[2], share * kernels.poly6_laplacian(r, h)])
