"""The classic method, compared with its formulas summed by brute force and with mechanics."""

import math

import numpy as np
import pytest

from msph.fluid.classic_parameters import ClassicParameters
from msph.fluid.external_forces import ExternalForces, Hand
from msph.fluid.particles.layers import LayerSpec
from tests.fluid.fluid_kit import advance, ball, lattice, masses, poly6, simulate, spec_of

SIZE = (0.8, 0.8, 0.8)
MASSES = (0.05, 0.2)
MU = (3.0, 7.0)


def cloud(terms, viscosities=MU):
    """Returns two interpenetrating layers with random velocities in the middle of the box."""
    specs = [
        LayerSpec(m, 1000.0, 2.0, viscosity=mu) for m, mu in zip(MASSES, viscosities, strict=True)
    ]
    rng = np.random.default_rng(1)
    x, v = rng.uniform(0.2, 0.55, (300, 3)), rng.normal(0.0, 1.0, (300, 3))
    return simulate(SIZE, specs, x, np.repeat([0, 1], 150), v, terms)


def spiky_slope(r, h):
    return -45 / (np.pi * h**6) * np.clip(h - r, 0, None) ** 2


def brute_force(terms, x, v, layer):
    """Returns rho (26) and accelerations (27), (28), or their variants, by sums over all pairs in
    double precision."""
    m, mu = np.array(MASSES)[layer], np.array(MU)[layer]
    h = 2.0 * (m / 1000.0) ** (1 / 3)
    d = x[:, None].astype(float) - x[None].astype(float)
    r = np.linalg.norm(d, axis=2)
    hj = np.tile(h, (len(x), 1))
    rho = (m * poly6(r, hj)).sum(axis=1)
    p = terms.stiffness * (rho - 1000.0)
    if not terms.tension:
        p = np.maximum(p, 0.0)
    np.fill_diagonal(r, np.inf)
    slope = spiky_slope(np.where(np.isinf(r), 0, r), hj) * np.isfinite(r)
    if terms.pressure_form != "mean":
        own = spiky_slope(np.where(np.isinf(r), 0, r), h[:, None]) * np.isfinite(r)
        slope = 0.5 * (slope + own)
    rho_i, rho_j = rho[:, None], rho[None]
    push = (p[:, None] + p) / (2 * rho_i * rho_j)
    if terms.pressure_form == "squared":
        push = p[:, None] / rho_i**2 + p / rho_j**2
    a = -((m * push * slope / r)[..., None] * d).sum(axis=1)
    lap = 45 / (np.pi * hj**6) * np.clip(hj - r, 0, None)
    if terms.viscosity_form == "formula":
        drag = m * mu[:, None] * lap / (rho_i * rho_j)
    else:
        drag = m * (mu[:, None] + mu) * lap / (2 * rho_i**2)
    return rho, a + (drag[..., None] * (v[None] - v[:, None])).sum(axis=1)


SWITCHES = {
    "formula": ClassicParameters(),
    "clamped squared": ClassicParameters(tension=False, pressure_form="squared"),
    "product, pseudocode": ClassicParameters(pressure_form="product", viscosity_form="pseudocode"),
}


@pytest.mark.parametrize("name", SWITCHES)
def test_densities_and_forces_equal_the_formulas(name):
    sim = cloud(SWITCHES[name])
    solver = sim.solver
    solver.find_accelerations()
    x, v, layer = (sim.particles.numpy(k) for k in ("x", "v", "layer"))
    rho, a = brute_force(SWITCHES[name], x, v, layer)
    assert np.allclose(sim.particles.numpy("density"), rho, rtol=1e-4)
    found = sim.particles.numpy("acceleration")
    assert np.abs(found - a).max() < 2e-4 * np.abs(a).max()


def test_stiffness_and_viscosity_change_in_a_running_simulation():
    """The second layer has its own viscosity. Regression: both values were compiled in."""
    terms = ClassicParameters()
    sim = cloud(terms, (terms.viscosity, 3.0))
    sim.solver.measure_density()
    before, step = sim.particles.numpy("pressure"), sim.solver.longest_step()
    changes = {"stiffness": 4.0 * terms.stiffness, "viscosity": 0.0}
    sim.solver.tune(terms.model_copy(update=changes))
    sim.solver.measure_density()
    assert sim.particles.numpy("pressure") == pytest.approx(4.0 * before, rel=1e-4)
    assert sim.solver.longest_step() == pytest.approx(0.5 * step)
    assert sim.layers.viscosity.to_numpy()[:2].tolist() == [0.0, 3.0]


def pair_force_sum(terms):
    """Returns |sum m a| / sum m |a| of a cloud at rest, zero if pair forces are antisymmetric."""
    sim = cloud(terms)
    sim.initial["v"][:] = 0.0
    sim.reset()
    solver = sim.solver
    solver.find_accelerations()
    m = masses(sim)[:, None]
    a = sim.particles.numpy("acceleration").astype(float)
    return np.linalg.norm((m * a).sum(axis=0)) / (m * np.linalg.norm(a, axis=1)[:, None]).sum()


def test_only_symmetrised_pressures_conserve_momentum_across_layers():
    """The thesis states that pair forces of (27) are not antisymmetric across layers."""
    assert pair_force_sum(SWITCHES["formula"]) > 1e-3
    assert pair_force_sum(SWITCHES["clamped squared"]) < 1e-5


@pytest.fixture
def lone():
    """Returns a simulation of one particle, on which only gravity, the hand, walls and the inertia
    of the box act."""
    x, v = np.array([[0.4, 0.6, 0.4]]), (0.3, 1.0, 0.0)
    half = LayerSpec(0.05, 1000.0, 2.0, gravity_factor=0.5)
    terms = ClassicParameters(tension=False)
    return simulate(SIZE, [half], x, v=v, terms=terms, restitution=0.5)


def test_free_fall_follows_position_verlet_and_the_layers_gravity(lone):
    dt, steps = 1e-3, 100
    for _ in range(steps):
        lone.solver.step(dt, ExternalForces())
    x, v = lone.particles.numpy("x")[0], lone.particles.numpy("v")[0]
    # x' = 2 x - x_old + dt^2 a from x_old = x - dt v gives x + n dt v + n (n + 1)/2 dt^2 a.
    a = np.array([0.0, -9.81 * 0.5, 0.0])
    expected = [0.4, 0.6, 0.4] + steps * dt * np.array([0.3, 1.0, 0.0])
    expected += steps * (steps + 1) / 2 * dt**2 * a
    assert np.allclose(x, expected, atol=1e-5)
    assert np.allclose(v, [0.3, 1.0 - 9.81 * 0.5 * steps * dt, 0.0], atol=1e-4)


def test_wall_reflects_with_its_restitution(lone):
    sideways, dt = 40.0, 0.1
    # 0.3 m/s and 40 m/s^2 for two steps: the particle passes the wall in the second step.
    speeds = []
    for _ in range(2):
        speeds.append(lone.particles.numpy("v")[0, 0])
        lone.solver.step(dt, ExternalForces(gravity=(sideways, 0.0, 0.0)))
    x, v = lone.particles.numpy("x")[0], lone.particles.numpy("v")[0]
    margin = 0.5 * lone.layers.specs[0].spacing
    before = speeds[-1] + dt * sideways * 0.5
    assert v[0] == pytest.approx(-0.5 * before, rel=1e-5)
    assert margin <= x[0] <= SIZE[0] - margin


def test_farthest_is_the_distance_that_the_fastest_particle_moved(lone):
    """The distance is right also in a step in which a wall stops the particle."""
    for _ in range(4):
        before = lone.particles.numpy("x")[0]
        lone.solver.step(0.1, ExternalForces(gravity=(40.0, 0.0, 0.0)))
        way = np.linalg.norm(lone.particles.numpy("x")[0] - before)
        assert lone.solver.farthest[None] == pytest.approx(way, rel=1e-4, abs=1e-6)


def test_hand_drags_water_to_its_own_velocity_and_not_beyond(lone):
    hand = Hand(position=(0.4, 0.6, 0.4), velocity=(0.0, 0.0, 2.0), radii=(0.5, 0.5, 0.5), grip=1e6)
    lone.solver.step(1e-3, ExternalForces(gravity=(0.0, 0.0, 0.0), hand=hand))
    assert np.allclose(lone.particles.numpy("v")[0], [0.0, 0.0, 2.0], atol=1e-4)


D = 0.03
TANK = (12 * D, 20 * D, 12 * D)


@pytest.fixture(params=["squared", "mean"], scope="module")
def column(request):
    """Still water of one layer, ten spacings deep."""
    layer = LayerSpec(1000.0 * D**3, 1000.0, 2.0, viscosity=10.0)
    terms = ClassicParameters(pressure_form=request.param)
    return simulate(TANK, [layer], lattice((12, 10, 12), D), terms=terms)


def settled_pressure_slope(sim):
    """Returns dp/dy [Pa/m] away from walls and surface and the speed [m/s] (root mean square):
    means over all frames of the third second, since the water oscillates too fast for fewer
    frames."""
    slopes, speeds = [], []
    for frame in range(180):
        advance(sim, 1)
        if frame < 120:
            continue
        x, v = sim.particles.numpy("x"), sim.particles.numpy("v")
        p = sim.solver.parameters.stiffness * (sim.particles.numpy("density") - 1000.0)
        near_middle = np.abs(x[:, [0, 2]] - TANK[0] / 2).max(axis=1) < 4 * D
        inside = near_middle & (x[:, 1] > 2 * D) & (x[:, 1] < 6.7 * D)
        slopes.append(np.polyfit(x[inside, 1], p[inside], 1)[0])
        speeds.append(math.sqrt((v**2).sum(axis=1).mean()))
    return np.mean(slopes), np.mean(speeds)


def test_only_squared_pressures_carry_the_hydrostatic_weight(column):
    """With (27) as printed, dp/dy is twice rho g: sum V_j (p_i + p_j)/2 grad W is half of grad p,
    so (27) lacks a factor of 2."""
    slope, speed = settled_pressure_slope(column)
    factor = 1.0 if column.solver.parameters.pressure_form == "squared" else 2.0
    assert slope == pytest.approx(-factor * 1000.0 * 9.81, rel=0.15)
    assert speed < 0.1


def test_attraction_pulls_the_surface_inwards():
    terms = ClassicParameters(stiffness=1e-6, attraction=50.0)
    sim = simulate(SIZE, [spec_of(D, 2.0)], ball(0.4, 0.1, D), terms=terms)
    sim.solver.find_accelerations()
    outward = sim.particles.numpy("x") - 0.4
    a = sim.particles.numpy("acceleration")
    radius = np.linalg.norm(outward, axis=1)
    shell = radius > 0.075
    radial = (a * outward).sum(axis=1)[shell] / radius[shell]
    # No particle is pushed outwards; on single particles below the threshold no force acts.
    assert radial.max() < 1e-4 * np.abs(radial).max()
    assert np.count_nonzero(radial < 0.0) > 0.8 * len(radial)
    middle = radius < 0.03
    assert np.abs(a[middle]).max() < 0.05 * np.abs(radial).max()
