"""Helpers for tests of the fluid: water on lattices, sums over particles and over all pairs, and
access to the parts of a solver."""

import math

import numpy as np
import taichi as ti

from bench import tanks
from msph.fluid.external_forces import ExternalForces
from msph.fluid.particles.layers import LayerSpec
from msph.fluid.particles.neighbour_list import PAIR_REACH
from msph.fluid.plan import Plan
from msph.fluid.projection.parameters import ProjectionParameters
from msph.fluid.simulation import Simulation
from msph.measure.ledger import Ledger

GRAVITY, FRAME = (0.0, -9.81, 0.0), 1 / 60
WEIGHTLESS = ExternalForces(gravity=(0.0, 0.0, 0.0))
# Overrides of the scene `drop`: coarse layers, and a splash in a low box that adapts all the time.
COARSE = tuple(f"layers.{k}.spacing={0.05 * 2 ** (k / 3):.6f}" for k in range(3))
SPLASH = (
    *("box.size=[0.8, 0.45, 0.8]", "water.0.hi=[0.8, 0.2, 0.8]", "water.1.centre=[0.4, 0.33, 0.4]"),
    *("adaptation.every=2", "adaptation.travel=0.3", *COARSE),
)


def spec_of(spacing, smoothing=2.45):
    """Returns a layer of water with a spacing [m]."""
    return LayerSpec(1000.0 * spacing**3, 1000.0, smoothing)


def lattice(counts, spacing, jitter=0.0, seed=0, corner=(0.0, 0.0, 0.0)):
    """Returns points (n, 3) [m] of a lattice from a corner on, moved at random by up to `jitter`
    spacings along each axis."""
    x = (np.indices(counts).reshape(3, -1).T + 0.5) * spacing + np.array(corner)
    return x + np.random.default_rng(seed).uniform(-jitter, jitter, x.shape) * spacing


def block_of(size, spacing, **options):
    """Returns the points of a lattice() that fills a box of a size [m]."""
    return lattice(np.round(np.array(size) / spacing).astype(int), spacing, **options)


def ball(centre, radius, spacing, offset=0.5):
    """Returns the points of a lattice in a ball, whose centre is `offset` spacings from a point."""
    n = int(radius / spacing) + 1
    axis = (np.arange(-n, n + 1) + offset) * spacing
    grid = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), -1).reshape(-1, 3)
    return grid[np.linalg.norm(grid, axis=1) < radius] + centre


def simulate(size, specs, x, layer=0, v=None, terms=None, **options):
    """Returns a simulation of particles at x (n, 3) [m]. layer, v [m/s]: one for all particles, or
    one for each; terms: parameters of the method; options: of the Plan."""
    initial = {"x": np.float32(x), "layer": np.full(len(x), layer, np.int32)}
    if v is not None:
        initial["v"] = np.broadcast_to(np.float32(v), initial["x"].shape).copy()
    return Simulation(Plan(tuple(size), specs, initial, terms or ProjectionParameters(), **options))


def advance(sim, frames, external=None, frame=FRAME):
    """Runs frames under gravity or other external forces."""
    for _ in range(frames):
        sim.advance(frame, external or ExternalForces())


def ledger_of(sim):
    """Returns a ledger without density errors that has an entry."""
    ledger = Ledger(sim, density_every=math.inf)
    ledger.record(GRAVITY)
    return ledger


def record(sim, seconds, gravity=GRAVITY, frame=FRAME):
    """Runs a simulation; returns a ledger with an entry at the start and after each frame."""
    return tanks.recorded(sim, seconds, lambda _: ExternalForces(gravity), frame=frame)


def parts(sim):
    """Returns the components of a simulation's world."""
    return sim.world.parts


def place(sim, **changes):
    """Replaces attributes of the particles, and measures their densities there."""
    sim.particles.fill(**(sim.particles.state() | changes))
    sim.solver.particles_moved()
    sim.measure_density()


def of_layers(sim, name):
    """Returns a property (n,) of the particles' layers, such as "mass" or "support"."""
    return np.array([getattr(s, name) for s in sim.layers.specs])[sim.particles.numpy("layer")]


def all_pairs(sim):
    """Returns V_i (n,), offsets r_ij (n, n, 3), distances and support radii (n, n) of all pairs."""
    (x,), volume, h = vectors(sim, "x"), of_layers(sim, "volume"), of_layers(sim, "support")
    d = x[:, None] - x
    return volume, d, np.linalg.norm(d, axis=2), pair_support(h, h)


def masses(sim):
    """Returns the masses (n,) [kg] of the particles."""
    return of_layers(sim, "mass")


def vectors(sim, *names):
    """Returns attributes of the particles, "x" and "v" unless given, in double precision."""
    return [sim.particles.numpy(name).astype(float) for name in names or "xv"]


def in_order(particles, *names):
    """Returns attributes of the particles in the order of their ids."""
    order = np.argsort(particles.numpy("id"))
    return [particles.numpy(name)[order] for name in names]


def momenta(sim, middle):
    """Returns momentum, angular momentum about a point, and the scales of both: sums of the
    particles' magnitudes."""
    m, (x, v) = masses(sim), vectors(sim)
    arm, speed = x - middle, np.linalg.norm(v, axis=1)
    linear, angular = m @ v, m @ np.cross(arm, v)
    return linear, angular, m @ speed, m @ (np.linalg.norm(arm, axis=1) * speed)


def drifts(before, after):
    """Returns the changes of momentum and angular momentum over the scales of momenta()."""
    changes = zip(before[:2], after[:2], before[2:], strict=True)
    return [np.linalg.norm(b - a) / scale for a, b, scale in changes]


def imbalance(before, after, seconds=0.0, gravity=GRAVITY):
    """Returns the change (3,) [N s] of the momentum between two entries of a ledger that the record
    does not explain: neither impulses, nor water that entered or left, nor gravity [m/s^2] on the
    water of the first entry in `seconds`."""
    given = ("wall_impulse", "internal_impulse", "inflow_impulse", "user_impulse")
    given += ("inertia_impulse",)
    names = {"momentum": 1.0, "spilt_momentum": 1.0, "outflow_momentum": 1.0}
    names |= dict.fromkeys(given, -1.0)
    change = sum(sign * (getattr(after, k) - getattr(before, k)) for k, sign in names.items())
    return change - before.mass * seconds * np.array(gravity)


def energies(sim):
    """Returns the kinetic and the potential energy [J] of the particles."""
    m, (x, v) = masses(sim), vectors(sim)
    return np.array([0.5 * m @ (v**2).sum(axis=1), 9.81 * m @ x[:, 1]])


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


def fill(field, values, kind=np.float32):
    """Sets the first elements of a field to values (n,) or (n, 3), and the others to zero."""
    rest = [(0, field.shape[0] - len(values)), (0, 0)]
    field.from_numpy(np.pad(values, rest[: values.ndim]).astype(kind))


def leave_in_copies(sim, value):
    """Fills the copies of attributes by which particles are moved, as scenes in the same memory
    leave them."""
    for _, copy in sim.particles._pairs:
        copy.fill(value)


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
    images = parts(sim).images
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


def poly6(r, h):
    """Returns the kernel of eq. 29 [1/m^3]."""
    return 315.0 / (64.0 * np.pi * h**3) * np.clip(1.0 - (r / h) ** 2, 0.0, None) ** 3


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


def repulsion(q):
    """Returns what a particle's own image at the distance q, in spacings, adds to c, and its
    derivative by q."""
    u = np.clip(1.0 - q / 0.7, 0.0, None)
    return 0.1 * u**2, -0.2 / 0.7 * u
