"""The thesis's method: weakly compressible multi-layer SPH (Gokdogan 2008, ch. 3 and A.2).

Densities and forces sum over all layers, each neighbour j with its own mass m_j and support h_j.
Equation numbers are the thesis's.
"""

from dataclasses import dataclass

import taichi as ti

from msph.fluid import kernels
from msph.fluid.accounts import Accounts
from msph.fluid.forcing import Forcing, hand_acceleration
from msph.fluid.grid import LayeredGrid
from msph.fluid.layers import Layers
from msph.fluid.neighbours import NeighbourList
from msph.fluid.obstacles import Walls
from msph.fluid.particles import Attribute, Particles
from msph.launch import data_oriented, kernel

# Explicit viscosity is stable while dt < VISCOUS_NUMBER h^2 rho / mu (Morris et al. 1997, eq. 19).
VISCOUS_NUMBER = 0.125

_ATTRIBUTES = (
    Attribute("density", "kg/m^3", "density by eq. 26"),
    Attribute("pressure", "Pa", "pressure by eq. 15", carried=False),
    Attribute("acceleration", "m/s^2", "what the other particles exert", width=3, carried=False),
)


@dataclass(frozen=True)
class ClassicTerms:
    """Constants and switches of the classic method.

    density rho0 [kg/m^3], stiffness k [m^2/s^2] of eq. 15, so that sqrt(k) is the speed of sound.
    tension: pressures below zero pull, as eq. 15 has it; False clamps them to zero.
    pressure_form: "mean" (27), "squared" (32) or "product" (33). (32) and (33) here use the
    gradient averaged over both supports: with the neighbour's alone, (33) is (27) divided by
    rho_i, and neither would be antisymmetric between layers, which is what they are for.
    viscosity_form: "formula" (28), or "pseudocode" (A.2): the mean of both layers' mu, over rho_i.
    attraction sigma [N/m]: pull at the surface by the colour field (Mueller et al. 2003, eq. 17
    to 19), 0 is off; it acts where the colour's gradient exceeds `colour_threshold` / h_j.
    courant: dt = courant * h_min / sqrt(k). restitution: share of speed kept at walls (-).
    """

    density: float = 1000.0
    stiffness: float = 200.0
    tension: bool = True
    pressure_form: str = "mean"
    viscosity_form: str = "formula"
    attraction: float = 0.0
    colour_threshold: float = 0.5
    courant: float = 0.4
    restitution: float = 0.0


@data_oriented
class Classic(Accounts):
    """One solver over the particles of all layers; a single layer is Mueller's SPH of 2003."""

    @staticmethod
    def attributes(terms: ClassicTerms, bodies: bool = False) -> tuple[Attribute, ...]:
        """What each particle has, beyond the core."""
        return _ATTRIBUTES

    # Margin of the neighbour list, in supports: a wider one is searched less often, read longer.
    LIST_MARGIN = 0.5
    # Numbers stored beside each neighbour.
    PER_ENTRY = 0

    def __init__(
        self,
        walls: Walls,
        layers: Layers,
        grid: LayeredGrid,
        particles: Particles,
        terms: ClassicTerms,
    ):
        super().__init__()
        self.size = walls.size
        self.layers = layers
        self.grid = grid
        self.particles = particles
        self.terms = terms
        self.own_kernels = any(s.wendland for s in layers.specs)
        self.symmetric = terms.pressure_form != "mean"
        self.neighbours = NeighbourList(grid, particles, self.reach(terms), self.LIST_MARGIN)
        self.farthest = ti.field(ti.f32, shape=())  # way of the fastest particle in a step [m]
        self.iterations = 0  # it solves nothing

    @staticmethod
    def reach(terms: ClassicTerms) -> str:
        """Form of the neighbour list: symmetrised pressures need either particle's support."""
        return "scatter" if terms.pressure_form == "mean" else "widest"

    def arrange(self) -> None:
        """Leaves the particles where the scene placed them, as the thesis does."""

    def longest_step(self, leeway: float = 1.0) -> float:
        """Largest stable time step [s]: sound crosses courant * h, viscosity diffuses within h.

        It never changes, so that no leeway is needed.
        """
        c = self.terms.stiffness**0.5
        steps = [self.terms.courant * s.support / c for s in self.layers.specs]
        viscous = [s for s in self.layers.specs if s.viscosity > 0.0]
        steps += [VISCOUS_NUMBER * s.support**2 * s.density / s.viscosity for s in viscous]
        return min(steps)

    def reset(self) -> None:
        """Forgets what it knew of the particles: they were replaced."""
        self.clear_accounts()
        self.grid.invalidate()
        self.grid.refresh()

    def step(self, dt: float, forcing: Forcing) -> None:
        """A.2: grid, densities and pressures, forces, positions and boundaries."""
        n = self.particles.count
        self.neighbours.refresh()
        self.find_densities(n)
        self.find_forces(n)
        self.move(n, dt, *forcing.arguments())
        self.neighbours.moved(self.farthest[None])
        self.grid.invalidate()

    @kernel
    def find_densities(self, n: ti.i32):
        """rho_i = sum_j m_j W(r_ij, h_j) (26) [kg/m^3]; p_i = k (rho_i - rho0) (15) [Pa]."""
        for i in range(n):
            layer = self.particles.layer[i]
            rho = self.layers.mass[layer] * self._density_kernel(
                0.0, self.layers.support[layer], layer
            )
            for s in range(self.neighbours.start[i], self.neighbours.end[i]):
                self._add_density(i, self.neighbours.index[s], rho)
            p = self.terms.stiffness * (rho - self.terms.density)
            if ti.static(not self.terms.tension):
                p = ti.max(p, 0.0)
            self.particles.density[i] = rho
            self.particles.pressure[i] = p

    @kernel
    def find_forces(self, n: ti.i32):
        """a_i = (f_pressure + f_viscosity + f_attraction) / rho_i [m/s^2]: (27), (28)."""
        for i in range(n):
            a = ti.Vector([0.0, 0.0, 0.0])
            for s in range(self.neighbours.start[i], self.neighbours.end[i]):
                self._add_forces(i, self.neighbours.index[s], a)
            if ti.static(self.terms.attraction > 0.0):
                a += self._attraction(i)
            self.particles.acceleration[i] = a

    @kernel
    def move(
        self,
        n: ti.i32,
        dt: ti.f32,
        g_x: ti.f32,
        g_y: ti.f32,
        g_z: ti.f32,
        hand_x: ti.f32,
        hand_y: ti.f32,
        hand_z: ti.f32,
        hand_v_x: ti.f32,
        hand_v_y: ti.f32,
        hand_v_z: ti.f32,
        hand_radius: ti.f32,
        hand_grip: ti.f32,
    ):
        """Position Verlet x' = 2 x - x_old + dt^2 a, v = (x - x_old)/dt, then reflecting walls.

        Written with v in place of x_old: x' = x + dt (v + dt a). The same recursion, but it keeps
        its digits in single precision and lets dt change. Particles stop half a spacing from the
        walls. The internal impulse sum m a dt [N s] would be zero were pair forces antisymmetric.
        """
        gravity, hand_at = ti.math.vec3(g_x, g_y, g_z), ti.math.vec3(hand_x, hand_y, hand_z)
        hand_v = ti.math.vec3(hand_v_x, hand_v_y, hand_v_z)
        self.farthest[None] = 0.0
        for i in range(n):
            layer = self.particles.layer[i]
            x, v = self.particles.x[i], self.particles.v[i]
            a = self.particles.acceleration[i]
            m = self.layers.mass[layer]
            self.book_internal(m, x, dt * a)
            a += gravity * self.layers.gravity_factor[layer]
            hand = hand_acceleration(x, v, dt, hand_at, hand_v, hand_radius, hand_grip)
            self.book_hand(m, v, dt, hand, a)
            v += dt * (a + hand)
            start, free = x, v
            x += dt * v
            margin = 0.5 * self.layers.spacing[layer]
            for k in ti.static(range(3)):
                lo, hi = margin, self.size[k] - margin
                if x[k] < lo or x[k] > hi:
                    wall = ti.select(x[k] < lo, lo, hi)
                    x[k] = ti.math.clamp(wall + self.terms.restitution * (wall - x[k]), lo, hi)
                    v[k] = -self.terms.restitution * v[k]
            self.wall_impulse[None] += m * (v - free)
            self.particles.x[i] = x
            self.particles.v[i] = v
            ti.atomic_max(self.farthest[None], (x - start).norm())

    @ti.func
    def _density_kernel(self, r, h, layer):
        w = 0.0
        if ti.static(self.own_kernels):
            if self.layers.wendland[layer] == 1:
                w = kernels.wendland(r, h)
            else:
                w = kernels.poly6(r, h)
        else:
            w = kernels.poly6(r, h)
        return w

    @ti.func
    def _pressure_slope(self, r, h, layer):
        slope = 0.0
        if ti.static(self.own_kernels):
            if self.layers.wendland[layer] == 1:
                slope = kernels.wendland_slope(r, h)
            else:
                slope = kernels.spiky_slope(r, h)
        else:
            slope = kernels.spiky_slope(r, h)
        return slope

    @ti.func
    def _add_density(self, i, j, rho: ti.template()):
        layer = self.particles.layer[j]
        h = self.layers.support[layer]
        r = (self.particles.x[i] - self.particles.x[j]).norm()
        rho += self.layers.mass[layer] * self._density_kernel(r, h, layer)

    @ti.func
    def _add_forces(self, i, j, a: ti.template()):
        l_i, l_j = self.particles.layer[i], self.particles.layer[j]
        m, h = self.layers.mass[l_j], self.layers.support[l_j]
        r_ij = self.particles.x[i] - self.particles.x[j]
        r = r_ij.norm()
        rho_i, rho_j = self.particles.density[i], self.particles.density[j]
        p_i, p_j = self.particles.pressure[i], self.particles.pressure[j]
        slope = self._pressure_slope(r, h, l_j)
        push = 0.0
        if ti.static(self.symmetric):
            slope = 0.5 * (slope + self._pressure_slope(r, self.layers.support[l_i], l_i))
        if ti.static(self.terms.pressure_form == "squared"):
            push = p_i / rho_i**2 + p_j / rho_j**2
        else:
            push = (p_i + p_j) / (2.0 * rho_i * rho_j)
        a -= m * push * slope * r_ij / ti.max(r, 1e-6 * h)
        drag = m * kernels.viscosity_laplacian(r, h)
        if ti.static(self.terms.viscosity_form == "formula"):
            drag *= self.layers.viscosity[l_i] / (rho_i * rho_j)
        else:
            drag *= (self.layers.viscosity[l_i] + self.layers.viscosity[l_j]) / (2.0 * rho_i**2)
        a += drag * (self.particles.v[j] - self.particles.v[i])

    @ti.func
    def _attraction(self, i):
        """-sigma lap(c) n/|n| / rho_i, n = grad c of the colour c = sum m_j/rho_j W [m/s^2]."""
        layer = self.particles.layer[i]
        h = self.layers.support[layer]
        share = self.layers.mass[layer] / self.particles.density[i]
        colour = ti.Vector([0.0, 0.0, 0.0, share * kernels.poly6_laplacian(0.0, h)])
        for s in range(self.neighbours.start[i], self.neighbours.end[i]):
            self._add_colour(i, self.neighbours.index[s], colour)
        normal = colour.xyz
        length = normal.norm()
        a = ti.Vector([0.0, 0.0, 0.0])
        if length * h > self.terms.colour_threshold:
            a = -self.terms.attraction * colour.w * normal / (length * self.particles.density[i])
        return a

    @ti.func
    def _add_colour(self, i, j, colour: ti.template()):
        layer = self.particles.layer[j]
        h = self.layers.support[layer]
        r_ij = self.particles.x[i] - self.particles.x[j]
        r = r_ij.norm()
        share = self.layers.mass[layer] / self.particles.density[j]
        n = share * kernels.poly6_slope(r, h) * r_ij / ti.max(r, 1e-6 * h)
        colour += ti.Vector([n[0], n[1], n[2], share * kernels.poly6_laplacian(r, h)])
