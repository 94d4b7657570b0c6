"""Bodies and containers: kernel shares compared with integrals, and the water they displace."""

import numpy as np
import pytest
import taichi as ti
import trimesh

from msph.fluid.boundary.body_shapes import BEGIN
from msph.fluid.boundary.mesh_samples import CELL
from msph.fluid.boundary.rigid_bodies import Ball, Block, Motion
from msph.fluid.boundary.sampled_fields import SampleLattice
from msph.fluid.boundary.signed_distance import signed_distance
from msph.fluid.boundary.volume_map import kernel_share
from msph.fluid.boundary.wall_integrals import ball_share, block_share, wall_support
from msph.fluid.external_forces import ExternalForces
from msph.measure.ledger import Ledger
from tests.boundary_kit import boundary_of, solid
from tests.fluid.fluid_kit import block_of, record, simulate, spec_of

D = 0.05
FINE, COARSE = (spec_of(d, 2.0) for d in (D, 1.6 * D))
H = wall_support(FINE)
SIZE = (1.0, 1.0, 1.0)
MIDDLE = np.array((0.5, 0.5, 0.5))


def kernel_points(n=48):
    """Returns points in the unit ball, (n, 3), and the Wendland kernel's share of each, h = 1.

    The points, midpoints of cells, are rotated: otherwise whole planes of points would lie on one
    side of a face.
    """
    axis = (np.arange(n) + 0.5) / n * 2.0 - 1.0
    points = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), -1).reshape(-1, 3)
    u = np.clip(1.0 - np.linalg.norm(points, axis=1), 0.0, None)
    weight = u**4 * (5.0 - 4.0 * u)
    aslant, _ = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))
    return points[u > 0.0] @ aslant, weight[u > 0.0] / weight.sum()


def share_inside(x, h, inside):
    """Returns the share of the kernel at each x (n, 3) in the region where inside(points) is True,
    by brute force."""
    points, weight = kernel_points()
    return np.array([(weight * inside(p + h * points)).sum() for p in x])


def octant(distances, n=120):
    """Returns the share of the kernel, h = 1, beyond three orthogonal planes at these distances, by
    the midpoint rule on cells that end at the planes."""
    axes, cell = [], 1.0
    for d in distances:
        edges = np.linspace(d, 1.0, n + 1)
        axes.append(0.5 * (edges[1:] + edges[:-1]))
        cell *= (1.0 - d) / n
    r = np.sqrt(sum(a**2 for a in np.meshgrid(*axes, indexing="ij", sparse=True)))
    u = np.clip(1.0 - r, 0.0, None)
    return 21.0 / (2.0 * np.pi) * cell * (u**4 * (5.0 - 4.0 * u)).sum()


NUMBERS = ti.types.ndarray(dtype=ti.f32, ndim=2)


@ti.data_oriented
class Evaluator:
    """Shares and distances, with gradients, (n, 4) of a boundary at points x; arrays, since a
    process has room for few fields."""

    def __init__(self, boundary, x, layer=0, body=0):
        self.boundary = boundary
        self.share, self.distance = (np.zeros((len(x), 4), np.float32) for _ in range(2))
        given = np.ascontiguousarray(x, np.float32), layer, body
        self.run(*given, self.share, self.distance)

    @ti.kernel
    def run(self, x: NUMBERS, layer: ti.i32, body: ti.i32, share: NUMBERS, distance: NUMBERS):
        for i in range(x.shape[0]):
            at = ti.Vector([x[i, 0], x[i, 1], x[i, 2]])
            found = self.boundary.open_share(at, layer, BEGIN)
            found.x = 1.0 - found.x
            found.yzw = -found.yzw
            away = self.boundary.distance(body, at, BEGIN)
            for k in ti.static(range(4)):
                share[i, k], distance[i, k] = found[k], away[k]


@pytest.mark.parametrize(
    ("mesh", "distance"),
    [
        (
            trimesh.creation.icosphere(4, radius=0.3),
            lambda x: np.linalg.norm(x, axis=-1) - 0.3,
        ),
        (
            trimesh.creation.box((0.4, 0.5, 0.6)),
            lambda x: (
                np.linalg.norm(np.maximum(abs(x) - (0.2, 0.25, 0.3), 0.0), axis=-1)
                + np.minimum((abs(x) - (0.2, 0.25, 0.3)).max(axis=-1), 0.0)
            ),
        ),
    ],
)
def test_signed_distance_of_a_mesh_equals_the_distance_of_its_shape(mesh, distance):
    lattice = SampleLattice.covering(*mesh.bounds, 0.1, 0.03)
    found = signed_distance(np.array(mesh.triangles), lattice, 0.1)
    node = np.stack(np.meshgrid(*map(np.arange, lattice.shape), indexing="ij"), -1)
    true = distance(np.array(lattice.origin) + lattice.cell * node)
    band = abs(true) < 0.099
    # The faces of the icosphere lie within 0.6 mm of the surface of the ball.
    assert abs(found - true)[band].max() < 7e-4
    assert np.all(np.sign(found) == np.sign(true), where=abs(true) > 7e-4)
    assert abs(found - true).max() < 0.15 * abs(true).max()


def test_share_of_a_mesh_is_the_kernels_integral_at_faces_edges_and_corners():
    mesh = trimesh.creation.box((3.0, 3.0, 3.0))
    mesh.apply_translation((1.5, 1.5, 1.5))
    lattice = SampleLattice.covering(*mesh.bounds, 1.0, 0.3)
    found = kernel_share(np.array(mesh.vertices), np.array(mesh.faces), lattice, 1.0)
    for node in ((0, 4, 2), (3, 5, 4), (4, 4, 4), (5, 6, 8), (6, 8, 5), (4, 9, 9), (2, 9, 9)):
        x = np.array(lattice.origin) + lattice.cell * np.array(node)
        expected = octant(np.clip(-x, -1.0, 1.0)) if (x > -1.0).all() else 0.0
        assert found[node] == pytest.approx(expected, abs=3e-4)


RADII = (0.15, 0.45, 1.0, 5.0)


@ti.kernel
def evaluate_balls(
    case: ti.types.ndarray(dtype=ti.f32, ndim=2), out: ti.types.ndarray(dtype=ti.f32, ndim=2)
):
    for i in range(case.shape[0]):
        found = ball_share(case[i, 0], 1.0, case[i, 1])
        out[i, 0], out[i, 1] = found[0], found[1]


def test_share_of_a_ball_is_the_kernels_integral_for_every_radius():
    gaps = np.linspace(-0.9, 0.9, 7)
    cases = [(r + s, r) for r in RADII for s in gaps if r + s > 0.02]
    step = 2e-3
    case = np.array([(d + e, r) for e in (0.0, step, -step) for d, r in cases], np.float32)
    out = np.zeros((len(case), 2), np.float32)
    evaluate_balls(case, out)
    n = len(cases)
    for (d, r), found in zip(cases, out[:n, 0], strict=True):
        centre = np.array((0.6, 0.0, 0.8)) * d
        brute = share_inside([centre], 1.0, lambda y, r=r: np.linalg.norm(y, axis=1) < r)[0]
        assert found == pytest.approx(brute, abs=2e-3)
    slope = (out[n : 2 * n, 0] - out[2 * n :, 0]) / (2.0 * step)
    assert abs(slope - out[:n, 1]).max() < 5e-3


def test_container_shaped_like_a_box_holds_water_as_the_box_does():
    edge = np.array((0.6, 0.5, 0.7))
    lo = MIDDLE - 0.5 * edge
    rng = np.random.default_rng(1)
    x = rng.uniform(0.0, 1.0, (300, 3)) * edge
    x[:200, 0] *= H / edge[0]
    x[:80, 1] *= H / edge[1]
    mesh = trimesh.creation.box(edge)
    held = Evaluator(
        boundary_of(SIZE, [FINE, COARSE], [solid(mesh, MIDDLE, container=True)]), lo + x
    )
    plain = np.zeros((len(x), 4), np.float32)

    @ti.kernel
    def box(x: ti.types.ndarray(dtype=ti.f32, ndim=2), out: ti.types.ndarray(dtype=ti.f32, ndim=2)):
        for i in range(x.shape[0]):
            at = ti.Vector([x[i, 0], x[i, 1], x[i, 2]])
            inside = block_share(at, H, ti.Vector([0.0] * 3), ti.Vector([0.6, 0.5, 0.7]))
            out[i, 0] = 1.0 - inside[0]
            for k in ti.static(range(3)):
                out[i, 1 + k] = -inside[1 + k]

    box(x.astype(np.float32), plain)
    difference = abs(held.share - plain)
    # The product formula of the box is off by at most 0.35 %. Regression: with Catmull-Rom cubics
    # the difference was twice as large, in gradients five times, and pressures at the sides of a
    # mesh were up to 2.4 % too high.
    assert difference[:, 0].max() < 4e-3
    assert np.sqrt((difference[:, 1:] ** 2).mean()) < 0.005 / H
    # Exact, except where two walls are equally near: there off by up to a third of a cell.
    missed = abs(held.distance[:, 0] - np.minimum(x, edge - x).min(axis=1))
    assert np.median(missed) < 1e-5 and missed.max() < 0.35 * CELL * H


def test_share_of_all_bodies_has_its_own_gradient_and_the_kernels_value():
    """Bodies that are apart: brute force for the coarse layer, and finite differences."""
    bodies = [
        Block(np.array((0.1, 0.1, 0.1)), np.array((0.3, 0.4, 0.3))),
        Ball(np.array((0.75, 0.7, 0.7)), 0.13),
        solid(trimesh.creation.icosphere(4, radius=0.12), (0.7, 0.25, 0.3)),
    ]
    rng = np.random.default_rng(2)
    x = np.concatenate(
        [
            rng.uniform(0.3, 0.4, (10, 3)) * (1.0, 1.0, 0.9),
            (0.75, 0.7, 0.7) + (0.13 + rng.uniform(0.0, 0.08, (10, 1))) * unit(rng, 10),
            (0.7, 0.25, 0.3) + (0.12 + rng.uniform(0.0, 0.08, (10, 1))) * unit(rng, 10),
        ]
    )
    step = 2e-4
    moved = [x + e * np.eye(3)[k] for k in range(3) for e in (step, -step)]
    boundary = boundary_of((1.0, 1.0, 1.0), [FINE, COARSE], bodies)
    found, n = Evaluator(boundary, np.concatenate([x, *moved]), layer=1).share, len(x)
    for k in range(3):
        up, down = found[n * (1 + 2 * k) :][:n, 0], found[n * (2 + 2 * k) :][:n, 0]
        # Noise of single precision is 1e-7/step.
        assert abs((up - down) / (2.0 * step) - found[:n, 1 + k]).max() < 0.05 / COARSE.support

    def inside(y):
        """Returns True for points y (n, 3) in the bodies."""
        block = ((y > bodies[0].lo) & (y < bodies[0].hi)).all(axis=1)
        ball = np.linalg.norm(y - bodies[1].centre, axis=1) < bodies[1].radius
        mesh = np.linalg.norm(y - (0.7, 0.25, 0.3), axis=1) < 0.12
        return block | ball | mesh

    assert abs(found[:n, 0] - share_inside(x, wall_support(COARSE), inside)).max() < 0.01
    # Faces of the mesh are up to 0.3 mm inside the ball, and distances are interpolated linearly.
    depth = np.linspace(-0.05, 0.05, 40)
    near = (0.7, 0.25, 0.3) + (0.12 + depth[:, None]) * unit(rng, 40)
    assert abs(Evaluator(boundary, near, body=2).distance[:, 0] - depth).max() < 1.5e-3


def unit(rng, n):
    v = rng.normal(size=(n, 3))
    return v / np.linalg.norm(v, axis=1, keepdims=True)


def water(lo, hi):
    """Returns positions on a slightly disturbed lattice of spacing D from lo to hi [m]."""
    return block_of(np.array(hi) - lo, D, jitter=0.02, corner=lo)


@pytest.fixture
def shaken():
    """Returns a half full, ball-shaped container with a swinging ball in it."""
    bodies = [
        solid(trimesh.creation.icosphere(3, radius=0.35), MIDDLE, container=True),
        Ball(np.array((0.4, 0.4, 0.5)), 0.1, Motion(swing=(0.2, 0.1, 0.0), period=0.4)),
    ]
    return simulate(SIZE, [FINE], water((0.1, 0.15, 0.1), (0.9, 0.5, 0.9)), bodies=bodies)


def test_particles_stop_at_walls_and_bodies():
    """Particles lose their speed towards walls, and the third takes the speed of the ball, which
    moves at 0.5 m/s. The fourth is faster than the ball and is not stopped."""
    x = [(0.3, 0.001, 0.3), (0.3, 0.4, 0.999), (0.701, 0.5, 0.5), (0.72, 0.5, 0.5)]
    v = [(1.0, -2.0, 0.5), (0.0, 1.0, 3.0), (-1.0, 2.0, 0.0), (2.0, 0.0, 0.0)]
    ball = Ball(MIDDLE, 0.2, Motion((0.5, 0.0, 0.0)))
    sim = simulate(SIZE, [FINE], np.array(x), v=np.array(v), bodies=[ball])
    p, dt = sim.particles, 1e-7
    p.fill(**sim.initial)
    sim.solver.impulses.clear()
    sim.measure_density()
    sim.boundary.place(0.0, dt)
    sim.contact.drift(dt)
    found, at, mass = p.numpy("v"), p.numpy("x"), FINE.mass
    after = [(1.0, 0.0, 0.5), (0.0, 1.0, 0.0), (0.5, 2.0, 0.0), (2.0, 0.0, 0.0)]
    assert found == pytest.approx(np.array(after), abs=1e-5)
    # Each particle is kept at a distance of its own, 0.05 to 0.1 spacings.
    assert 0.05 * D <= at[0, 1] <= 0.1 * D and 0.05 * D <= SIZE[2] - at[1, 2] <= 0.1 * D
    assert 0.05 * D - 1e-6 <= at[2, 0] - 0.7 <= 0.1 * D
    assert at[3] == pytest.approx((0.72, 0.5, 0.5), abs=1e-5)
    pushed = -sim.boundary.impulse[0]
    assert pushed == pytest.approx(np.array((1.5 * mass, 0.0, 0.0)), abs=1e-5 * mass)
    assert sim.solver.impulses.wall_work.total[None] == pytest.approx(0.75 * mass, rel=1e-5)


def test_violent_water_stays_in_its_container_and_leaks_are_counted(shaken):
    shaken.reset()
    ledger = Ledger(shaken)
    laid = len(water((0.1, 0.15, 0.1), (0.9, 0.5, 0.9)))
    assert 0 < shaken.particles.count == laid - shaken.left_out
    for k in range(24):
        gravity = (30.0 * (-1) ** (k // 6), -9.81, 20.0 * (-1) ** (k // 4))
        shaken.advance(1 / 60, ExternalForces(gravity=gravity))
        assert ledger.record((0.0, -9.81, 0.0)).outside == 0
    assert ledger.entries[-1].top_speed > 1.0
    r = np.linalg.norm(shaken.particles.numpy("x") - MIDDLE, axis=1)
    assert r.max() < 0.35 + 0.01 * D
    state = shaken.particles.state()
    state["x"][0] = MIDDLE + np.array((0.0, 0.35 + 0.2 * D, 0.0))
    state["x"][1] = MIDDLE + np.array((0.35 + 0.05 * D, 0.0, 0.0))  # too near to count
    state["x"][2] = shaken.boundary.centre[1, 1].to_numpy()
    shaken.particles.fill(**state)
    assert ledger.record((0.0, -9.81, 0.0)).outside == 2


def test_piston_lifts_the_water_it_displaces_and_its_work_balances():
    """A block over the whole cross-section pushes water along x at 0.25 m/s: the water has the
    level and momentum that volumes give, and the work covers the gain of potential energy."""
    length, width, front, speed = 0.8, 0.3, 0.1, 0.25
    piston = Block(
        np.array((-0.3, 0.0, 0.0)), np.array((front, 0.8, width)), Motion((speed, 0.0, 0.0))
    )
    x = water((front, 0.0, 0.0), (length, 0.3, width))
    sim = simulate((length, 0.8, width), [FINE], x, bodies=[piston])
    ledger = record(sim, 1.2)
    first, last = ledger.entries[0], ledger.entries[-1]
    face = front + 1.2 * speed
    assert sim.particles.numpy("x")[:, 0].min() > face - 1e-5
    depth = first.mass / 1000.0 / (width * (length - face))
    assert last.centre[0] == pytest.approx(0.5 * (face + length), rel=0.02)
    assert last.centre[1] == pytest.approx(0.5 * depth, rel=0.04)
    momentum = np.mean([e.momentum[0] for e in ledger.entries[1:]])
    assert momentum == pytest.approx(first.mass * 0.5 * speed, rel=0.08)
    # The first six frames, in which the lattice settles as it would at rest, are left out.
    settled = ledger.entries[6:]
    assert last.work - settled[0].work > 0.9 * (last.potential - settled[0].potential) > 30.0
    assert np.diff([e.energy for e in settled]).max() < 1e-3 * first.energy
