"""Viscosity: pair forces along the line of centres, explicit or implicit as the step asks.

lap v_i = sum V_j a(r_ij, h_ij) (v_ji.e_ij) e_ij, e_ij = r_ij/r_ij (form of Monaghan 2005, eq. 4.1,
which for a kernel W has a = -10 W'/r). Forces are equal, opposite and central, so momentum and
angular momentum are kept, and water that turns as one is not braked. The more usual form along
v_ij (Morris et al. 1997) brakes it wherever there is a surface.

The weight a is not taken from the kernel that pressures use: Wendland C2's slope is so narrow that
of 33 neighbours only the nearest 6 count, and on a cubic lattice a shear wave decays with .59 to
1.57 times the viscosity asked for, by its direction. With a ~ (1 - q^2)^1.5 it is 1.02 to 1.05.
"""

import math

import taichi as ti

from msph.fluid.layers import Layers
from msph.fluid.neighbours import NeighbourList
from msph.fluid.particles import Attribute, Particles
from msph.fluid.pressure_solve import PressureSolve
from msph.launch import data_oriented, kernel

ATTRIBUTES = (
    Attribute("viscous_residual", "m/s", "change by viscosity yet to come", 3, carried=False),
    Attribute("viscous_direction", "m/s", "search direction of viscosity", 3, carried=False),
    Attribute("viscous_diagonal", "-", "diagonal of viscosity's operator", 3, carried=False),
)

# a = WEIGHT (1 - q^2)^1.5/h^5: the integral of r^2 a over space must be 30.
WEIGHT = 640.0 / math.pi**2
# A particle's own share of lap v, by axis, in 1/h^2: a third of the integral of a over space.
STIFFNESS = 80.0 / 3.0
# Largest dt nu STIFFNESS/h^2 of an explicit step. Eigenvalues of lap reach 1.8 STIFFNESS/h^2
# (measured), so up to .55 no mode overshoots, and from 1.1 on it explodes.
EXPLICIT = 0.5
# Share of the residual's norm that the implicit solve may leave, and its most iterations.
TOLERANCE, MOST = 1e-3, 60
# Iterations between looks at the residual, which wait for the device.
LOOK = 3
# Across a wall without slip nothing depends on the direction: r^2 a must have the integral 6.
NO_SLIP = 0.2
# Keeps divisions by what may vanish finite.
TINY = 1e-30


@data_oriented
class Viscosity:
    """Applies a dynamic viscosity [Pa s] to the velocities of water of a density [kg/m^3].

    slip: walls do not brake. The step is explicit where that is stable, else backward Euler:
    conjugate gradients on v - dt nu lap v = v*, symmetric and positive under the weights V.
    iterations counts those of the last step, 0 if explicit.
    """

    def __init__(
        self,
        layers: Layers,
        particles: Particles,
        neighbours: NeighbourList,
        pressure_solve: PressureSolve,
        viscosity: float,
        density: float,
        slip: bool,
    ):
        self.layers, self.particles, self.neighbours = layers, particles, neighbours
        self.images, self.pressure_solve = neighbours.images, pressure_solve
        self.nu, self.density, self.slip = viscosity / density, density, slip
        self.stiffness = self.nu * STIFFNESS / layers.finest.support**2
        self.descent = ti.field(ti.f32, shape=())
        self.last_descent = ti.field(ti.f32, shape=())
        self.curvature = ti.field(ti.f32, shape=())
        self.iterations = 0

    def run(self, n: int, dt: float) -> None:
        """Velocities after dt [s] of viscosity.

        The last step's pressure is lent to them meanwhile. Without it viscosity would brake the
        fall of water at rest on its floor, which the pressure has yet to stop, and bear its weight.
        """
        span, p = dt * self.nu, self.particles
        self.pressure_solve.find_shifts(n, p.alone, p.multiplier, p.shift)
        self.lend_pressure(n, dt / self.density)
        self.iterations = 0
        if dt * self.stiffness <= EXPLICIT:
            self.brake(n, span)
        else:
            self.begin(n, span)
            goal = TOLERANCE**2 * self.descent[None]
            while self.iterations < MOST and self.descent[None] > goal:
                for _ in range(LOOK):
                    self.iterate(n, span)
                self.iterations += LOOK
        self.finish(n, dt / self.density)

    @kernel
    def lend_pressure(self, n: ti.i32, factor: ti.f32):
        """v += factor u, with factor = dt/rho [m^3 s/kg] and u the pressures' shifts [Pa/m]."""
        for i in range(n):
            self.particles.v[i] += factor * self.particles.shift[i]

    @kernel
    def brake(self, n: ti.i32, span: ti.f32):
        """Explicit: leaves dt nu lap v as the residual; span = dt nu [m^2]."""
        for i in range(n):
            self.particles.viscous_residual[i] = span * self.laplacian(i, self.particles.v)

    @kernel
    def begin(self, n: ti.i32, span: ti.f32):
        """r = dt nu lap v*, and the first direction r/D."""
        self.descent[None] = 0.0
        for i in range(n):
            r = span * self.laplacian(i, self.particles.v)
            d = 1.0 + span * self.diagonal(i)
            self.particles.viscous_residual[i] = r
            self.particles.viscous_diagonal[i] = d
            self.particles.viscous_direction[i] = r / d
            self.descent[None] += self.layers.volume[self.particles.layer[i]] * r.dot(r / d)

    @kernel
    def iterate(self, n: ti.i32, span: ti.f32):
        """v += alpha p; r -= alpha (p - dt nu lap p); p = r/D + beta p."""
        self.curvature[None] = 0.0
        for i in range(n):
            p = self.particles.viscous_direction[i]
            response = p - span * self.laplacian(i, self.particles.viscous_direction)
            self.particles.exchange[i] = response
            volume = self.layers.volume[self.particles.layer[i]]
            self.curvature[None] += volume * p.dot(response)
        self.last_descent[None] = self.descent[None]
        self.descent[None] = 0.0
        for i in range(n):
            alpha = self.last_descent[None] / ti.max(self.curvature[None], TINY)
            r = self.particles.viscous_residual[i] - alpha * self.particles.exchange[i]
            self.particles.v[i] += alpha * self.particles.viscous_direction[i]
            self.particles.viscous_residual[i] = r
            volume = self.layers.volume[self.particles.layer[i]]
            self.descent[None] += volume * r.dot(r / self.particles.viscous_diagonal[i])
        for i in range(n):
            beta = self.descent[None] / ti.max(self.last_descent[None], TINY)
            self.particles.viscous_direction[i] = (
                self.particles.viscous_residual[i] / self.particles.viscous_diagonal[i]
                + beta * self.particles.viscous_direction[i]
            )

    @kernel
    def finish(self, n: ti.i32, factor: ti.f32):
        """v += r - factor u: takes the pressure back. With r all that velocities have gained is
        dt nu lap v of the solve's v, so that momenta are kept however early it stopped."""
        for i in range(n):
            lent = factor * self.particles.shift[i]
            self.particles.v[i] += self.particles.viscous_residual[i] - lent

    @ti.func
    def laplacian(self, i, field: ti.template()):
        """lap of a vector field on the particles [its unit / m^2]."""
        x, v, total = self.particles.x[i], field[i], ti.Vector([0.0, 0.0, 0.0])
        layer = self.particles.layer[i]
        for s in range(self.neighbours.start[i], self.neighbours.mirrors[i]):
            j = self.neighbours.index[s]
            r_ij = x - self.particles.x[j]
            total += self.weight(layer, j, r_ij) * (field[j] - v).dot(r_ij) * r_ij
        for s in range(self.neighbours.mirrors[i], self.neighbours.end[i]):
            j, mirror, wall = self.images.read(self.neighbours.index[s])
            r_ij = self.images.offset(x, self.particles.x[j], mirror, wall)
            weight = self.weight(layer, j, r_ij)
            if ti.static(self.slip):
                total += weight * (mirror * field[j] - v).dot(r_ij) * r_ij
            else:
                # Images move against the water, so that it stands at the wall.
                total -= NO_SLIP * weight * r_ij.norm_sqr() * (field[j] + v)
        return total

    @ti.func
    def diagonal(self, i):
        """-d lap v_i/d v_i by axis [1/m^2], a particle's own images held fixed."""
        x, total = self.particles.x[i], ti.Vector([0.0, 0.0, 0.0])
        layer = self.particles.layer[i]
        for s in range(self.neighbours.start[i], self.neighbours.mirrors[i]):
            j = self.neighbours.index[s]
            r_ij = x - self.particles.x[j]
            total += self.weight(layer, j, r_ij) * r_ij * r_ij
        for s in range(self.neighbours.mirrors[i], self.neighbours.end[i]):
            j, mirror, wall = self.images.read(self.neighbours.index[s])
            r_ij = self.images.offset(x, self.particles.x[j], mirror, wall)
            weight = self.weight(layer, j, r_ij)
            if ti.static(self.slip):
                total += weight * r_ij * r_ij
            else:
                total += NO_SLIP * weight * r_ij.norm_sqr()
        return total

    @ti.func
    def weight(self, layer, j, r_ij):
        """V_j a/r^2 [1/m^4]."""
        other = self.particles.layer[j]
        per_h, r2 = self.layers.per_h[layer, other], r_ij.norm_sqr()
        u = ti.max(1.0 - r2 * per_h * per_h, 0.0)
        return self.layers.volume[other] * WEIGHT * per_h**5 * u * ti.sqrt(u) / ti.max(r2, TINY)
