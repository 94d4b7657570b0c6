"""Helpers for tests of the projection method: sums over all pairs of particles, colliding balls."""

import numpy as np
import taichi as ti

from msph.fluid.adaptivity.bands import AdaptationParameters
from msph.fluid.external_forces import ExternalForces
from msph.fluid.particles.layers import LayerSpec
from msph.fluid.particles.neighbour_list import PAIR_REACH
from msph.fluid.plan import Plan
from msph.fluid.projection.parameters import ProjectionParameters
from msph.fluid.simulation import Simulation

# Yield of kernel sums under uniform expansion, by support radius over spacing; see density.py.
YIELD = {2.4: 0.9964, 2.5: 0.9970}


def pair_support(h, other):
    """Returns the support radii (n, m) of all pairs of particles with radii h (n,), other (m,)."""
    return (0.5 * (h[:, None] ** 2.5 + other**2.5)) ** 0.4


def listed(r, h):
    """Returns which pairs at distances r [m] with support radii h [m] are in the neighbour list."""
    return r < PAIR_REACH * h


def relative_density(summed, smoothing):
    """Returns c, given sums of V_j W_ij without yield correction, the own contribution included."""
    return 1.0 + (summed - 1.0) / YIELD[smoothing]


def fill(field, values):
    """Sets the first n elements of a field (capacity,) to values (n,) and the others to zero."""
    field.from_numpy(np.pad(values.astype(np.float32), (0, field.shape[0] - len(values))))


def displacements(sim):
    """Returns the displacements (n, 3) [m] caused by the velocity multipliers of a simulation."""
    operator, p = sim.solver.pressure_solve.operator, sim.particles

    @ti.kernel
    def displace(n: ti.i32):
        operator.apply(n, p.velocity_multiplier)

    displace(p.count)
    return p.numpy("displacement").astype(float)


def spans(sim, kind):
    """Returns first and end, (n,) each, of the particles' "neighbours", "images" or "body images";
    the latter two are rows of one table."""
    p, neighbours = sim.particles, sim.solver.neighbours
    if kind == "neighbours":
        return tuple(f.to_numpy()[: p.count] for f in (neighbours.start, neighbours.end))
    return p.numpy("first_image" if kind == "images" else "body_image"), p.numpy("image_end")


def neighbours_of(sim):
    """Returns the lists of the particles' neighbours."""
    index = sim.solver.neighbours.index.to_numpy()
    return [index[a:b].tolist() for a, b in zip(*spans(sim, "neighbours"), strict=True)]


def images_of(sim):
    """Returns the set of (i, j, mirrors) of all images."""
    images = sim.world.parts.images
    index, mirrors = images.index.to_numpy().tolist(), images.mirrors.to_numpy().tolist()
    ends = enumerate(zip(*spans(sim, "images"), strict=True))
    return {(i, index[s], mirrors[s]) for i, (a, b) in ends for s in range(a, b)}


def sum_of_entries(sim, kind):
    """Returns the sums (n, 3) [1/m] of the gradients of the particles' entries of a kind of
    spans()."""
    density = sim.solver.density
    field = density.pair_gradient if kind == "neighbours" else density.images.gradient
    gradient = field.to_numpy()
    return np.array([gradient[a:b].sum(axis=0) for a, b in zip(*spans(sim, kind), strict=True)])


def quartic(r, h):
    """Returns W [1/m^3] of the quartic B-spline at distances r [m] for support radii h [m]."""
    q = r / h
    terms = [(1, 1), (-5, 0.6), (10, 0.2)]
    w = sum(k * np.clip(end - q, 0, None) ** 4 for k, end in terms)
    return 15625 / (512 * np.pi * h**3) * w


def quartic_slope(r, h):
    """Returns dW/dr [1/m^4] of the quartic B-spline."""
    q = r / h
    terms = [(1, 1), (-5, 0.6), (10, 0.2)]
    w = sum(-4 * k * np.clip(end - q, 0, None) ** 3 for k, end in terms)
    return 15625 / (512 * np.pi * h**4) * w


TANK, DEPTH = (0.6, 0.6, 0.6), 0.36  # tank of coarse_tank() and its depth [m]


def coarse_tank(capacity):
    """Returns the plan of a tank of coarse particles in three layers, which depth will split."""
    coarse = 0.03 * 2 ** (2 / 3)
    n, rows = round(TANK[0] / coarse), round(DEPTH / coarse)
    width = TANK[0] / n
    x = (np.indices((n, rows, n)).reshape(3, -1).T + 0.5) * [width, DEPTH / rows, width]
    initial = {"x": x.astype(np.float32), "layer": np.full(len(x), 2, np.int32)}
    mass = 1000.0 * DEPTH * TANK[0] * TANK[2] / len(x)
    specs = [LayerSpec(mass / 2**k, 1000.0, 2.5) for k in (2, 1, 0)]
    adaptation = AdaptationParameters(band=1.5)
    return Plan(TANK, specs, initial, ProjectionParameters(), (), adaptation, capacity=capacity)


def repulsion(q):
    """Returns what a particle's own image at the distance q, in spacings, adds to c, and its
    derivative by q."""
    u = np.clip(1.0 - q / 0.7, 0.0, None)
    return 0.1 * u**2, -0.2 / 0.7 * u


SIZE = (1.6, 1.6, 1.6)
WEIGHTLESS = ExternalForces(gravity=(0.0, 0.0, 0.0))
FINE, COARSE = (LayerSpec(1000.0 * d**3, 1000.0, 2.5) for d in (0.03, 0.06))


def ball(centre, radius, spacing):
    n = int(radius / spacing) + 1
    axis = np.arange(-n, n + 1) * spacing
    grid = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), -1).reshape(-1, 3)
    return grid[np.linalg.norm(grid, axis=1) < radius] + centre


def colliding_balls():
    """Returns a simulation of a fine and a coarse ball (masses of particles 1 : 8) that collide off
    centre."""
    fine = ball((0.67, 0.82, 0.8), 0.12, 0.03)
    coarse = ball((0.96, 0.78, 0.8), 0.15, 0.06)
    x = np.concatenate([fine, coarse])
    v = np.zeros_like(x)
    v[: len(fine), 0], v[len(fine) :, 0] = 1.5, -1.0
    layer = np.repeat([0, 1], [len(fine), len(coarse)])
    x += np.random.default_rng(0).uniform(-1e-3, 1e-3, x.shape)
    particles = {
        "x": x.astype(np.float32),
        "v": v.astype(np.float32),
        "layer": layer.astype(np.int32),
    }
    return Simulation(Plan(SIZE, [FINE, COARSE], particles, ProjectionParameters()))
