"""Splits and merges by depth: conservation, bands, capacity, water at rest, rounded spacings, and
deep water."""

import numpy as np
import pytest

from msph.fluid.adaptivity.bands import (
    AdaptationParameters,
    bands,
    coarser_of,
    farthest_depth,
    with_exact_ratios,
)
from msph.fluid.particles.layers import LayerSpec
from tests.fluid.fluid_kit import (
    WEIGHTLESS,
    advance,
    ball,
    drifts,
    energies,
    lattice,
    masses,
    momenta,
    simulate,
    spec_of,
    vectors,
)

SIZE = (2.4, 2.4, 2.4)
MIDDLE = 1.2
D = 0.03
SPECS = [LayerSpec(1000.0 * D**3 * 2**k, 1000.0, 2.5) for k in range(3)]
TANK, DEPTH = (0.6, 0.6, 0.6), 0.36  # tank of coarse_tank() and its depth [m]


def coarse_tank(capacity):
    """Returns a tank of coarse particles in three layers, which depth will split."""
    coarse = 0.03 * 2 ** (2 / 3)
    n, rows = round(TANK[0] / coarse), round(DEPTH / coarse)
    width = TANK[0] / n
    x = lattice((n, rows, n), 1.0) * [width, DEPTH / rows, width]
    mass = 1000.0 * DEPTH * TANK[0] * TANK[2] / len(x)
    specs = [LayerSpec(mass / 2**k, 1000.0, 2.5) for k in (2, 1, 0)]
    adaptation = AdaptationParameters(band=1.5)
    return simulate(TANK, specs, x, 2, adaptation=adaptation, capacity=capacity)


@pytest.fixture
def collision():
    """Returns a fine and a coarse ball that collide off centre; particles of both change layer."""
    fine, coarse = (
        ball((1.02, 1.24, 1.2), 0.15, SPECS[0].spacing),
        ball((1.38, 1.16, 1.2), 0.15, SPECS[2].spacing),
    )
    first = np.arange(len(fine) + len(coarse)) < len(fine)
    v = np.where(first, 1.0, -1.0)[:, None] * [1.0, 0.0, 0.0]
    adaptation = AdaptationParameters(band=0.7, every=2)
    options = {"adaptation": adaptation, "capacity": 3000}
    return simulate(SIZE, SPECS, np.concatenate([fine, coarse]), 2 * ~first, v, **options)


def test_collision_keeps_mass_and_momenta_through_splits_and_merges(collision):
    mass = masses(collision).sum()
    before = momenta(collision, MIDDLE)
    start = set(collision.particles.numpy("id"))
    # Thin bands, as in a full pool, cause merges; wide bands then split the merged particles.
    for thickness in (0.35, 1.0):
        collision.solver.adaptation.thickness = thickness
        advance(collision, 12, WEIGHTLESS)
    now = set(collision.particles.numpy("id"))
    assert len(now) == collision.particles.count, "ids are unique"
    assert len(now - start) > 20 and len(start - now) > 20, "splits and merges must happen"
    assert masses(collision).sum() == pytest.approx(mass, rel=1e-12)
    linear, angular = drifts(before, momenta(collision, MIDDLE))
    assert linear < 1e-5 and angular < 1e-4


def test_a_pass_keeps_the_centre_of_mass_and_records_its_energy_loss(collision):
    """A single pass without a step loses the kinetic energy that it adds to merge_loss."""

    def facts():
        linear, angular, _, _ = momenta(collision, MIDDLE)
        centre = np.average(vectors(collision)[0], axis=0, weights=masses(collision))
        return linear, angular, centre, energies(collision)[0]

    advance(collision, 8, WEIGHTLESS)
    solver = collision.solver
    linear, angular, centre, kinetic = facts()
    loss = solver.impulses.merge_loss.total[None]
    solver.neighbours.refresh()
    solver.particles.settling.fill(0)
    solver.adaptation.thickness = 0.6
    assert solver.adaptation.run(budget=1.0) > 20
    solver.grid.invalidate()
    linear_after, angular_after, centre_after, kinetic_after = facts()
    assert linear_after == pytest.approx(linear, abs=1e-5)
    assert centre_after == pytest.approx(centre, abs=1e-6)
    assert angular_after == pytest.approx(angular, abs=1e-4 * np.abs(angular).max())
    loss = solver.impulses.merge_loss.total[None] - loss
    assert loss > 0.0
    assert kinetic - kinetic_after == pytest.approx(loss, rel=1e-2)


@pytest.fixture(scope="module")
def tank():
    """Returns a tank of coarse particles after 2 s, by which depth has split them into three
    layers, and the number of particles per layer in each frame."""
    sim, counts = coarse_tank(4000), []
    for _ in range(120):
        advance(sim, 1)
        counts.append(sim.counts())
    return sim, np.array(counts)


def test_depth_is_the_distance_to_the_surface(tank):
    """The surface is half a fine spacing above the highest particle within 1.5 fine spacings: at
    times particles in a corner rise above level water."""
    sim, _ = tank
    sim.solver.adaptation.depth.refresh()
    sim.solver.adaptation.mark_particles(sim.particles.count, 1.0, 1.0)
    depth, x = (sim.particles.numpy(name) for name in ("depth", "x"))
    fine, y = sim.layers.specs[0].spacing, x[:, 1]
    aside = np.linalg.norm(x[:, None, ::2] - x[None, :, ::2], axis=2)
    surface = np.where(aside < 1.5 * fine, y, 0.0).max(axis=1) + 0.5 * fine
    inside = (depth > 0.0) & (depth < 0.9 * farthest_depth(sim.layers.specs, sim.plan.adaptation))
    error = (depth - (surface - y))[inside]
    assert inside.sum() > 500
    assert np.abs(error).max() < 0.6 * sim.plan.constants()["depth_cell"]
    assert abs(error.mean()) < 0.2 * sim.plan.constants()["depth_cell"]


def test_layers_lie_in_their_bands(tank):
    sim, _ = tank
    specs = sim.layers.specs
    assert coarser_of(specs) == [1, 2, -1]
    depth, layer = DEPTH - sim.particles.numpy("x")[:, 1], sim.particles.numpy("layer")
    for k, (top, bottom) in enumerate(bands(specs, 1.5)):
        slack, beyond = 0.5 * specs[0].support, sim.solver.adaptation.parameters.hysteresis
        own = depth[layer == k]
        assert len(own) > 50
        assert (
            np.mean((own > (1 - beyond) * top - slack) & (own < (1 + beyond) * bottom + slack))
            > 0.99
        )


def test_water_at_rest_stops_adapting(tank):
    _, counts = tank
    changes = np.abs(np.diff(counts, axis=0)).sum(axis=1)
    assert changes[-45:].max() == 0


def test_passes_are_due_only_after_water_has_travelled(tank):
    """A pass is due at every eighth step, if the fastest particle has travelled four spacings."""
    adaptation = tank[0].solver.adaptation
    adaptation.steps = 7
    adaptation.travelled = 3.9
    assert not adaptation.pass_due()
    adaptation.travelled = 4.1
    assert [adaptation.pass_due() for _ in range(8)] == [False] * 7 + [True]
    assert adaptation.travelled == 0.0


def test_a_split_does_not_lower_the_water(tank):
    """A split changes the mean height by less than 2e-5 of the depth: the position correction then
    takes more rounds, which must not lift the water less."""
    sim, _ = tank
    p, adaptation = sim.particles, sim.solver.adaptation

    def height():
        advance(sim, 1, frame=1 / 120)
        return np.average(p.numpy("x")[:, 1].astype(float), weights=masses(sim))

    before = [height() for _ in range(10)]
    middle = np.abs(p.numpy("x") - np.array(TANK) / 2).sum(axis=1) + (p.numpy("layer") != 1)
    mark = np.zeros(p.x.shape[0], np.int32)
    mark[middle.argmin()] = -1
    p.mark.from_numpy(mark)
    adaptation.tally.fill(0)
    adaptation.split(p.count, 8, p.capacity)
    p.count += 1
    sim.solver.particles_moved()
    after = [height() for _ in range(10)]
    assert np.abs(np.array(after) - before[-1]).max() < 2e-5 * DEPTH


def rested(capacity):
    """Returns the tank with room for `capacity` particles after 0.5 s, its number of particles, and
    their masses [kg]."""
    sim = coarse_tank(capacity)
    advance(sim, 30)
    return sim, sim.particles.count, masses(sim)


def test_a_full_pool_coarsens_and_keeps_its_mass():
    sim, wanted, finer = rested(4000)
    sim.close()
    small, count, coarser = rested(int(0.7 * wanted))
    assert count <= small.particles.capacity
    assert small.solver.adaptation.thickness < 1.0
    assert coarser.sum() == pytest.approx(finer.sum(), rel=1e-12)
    # Fine particles still lie at the surface.
    y, layer = small.particles.numpy("x")[:, 1], small.particles.numpy("layer")
    assert y[layer == 0].mean() > y[layer == 2].mean() + 0.1


def test_merges_double_masses_of_rounded_spacings_exactly():
    specs = [spec_of(d, 2.5) for d in (0.050797, 0.032, 0.040317, 0.1)]
    exact = [s.mass for s in with_exact_ratios(specs)]
    assert exact[2] == 2.0 * exact[1] and exact[0] == 2.0 * exact[2]
    assert exact[1] == specs[1].mass and exact[3] == specs[3].mass


def test_deep_water_of_halved_cubes_starts_at_rest_density():
    """Regression: 100 rounds left some of the water too dense, which lifted it and raised its
    energy."""
    fine = 0.02
    specs = [LayerSpec(1000.0 * fine**3 * 2**k, 1000.0, 2.45) for k in range(3)]
    cells = np.array([5, 38, 5])
    size = cells * specs[2].spacing
    x, box = lattice(cells, specs[2].spacing), (size[0], size[1] + 0.3, size[2])
    adaptation = AdaptationParameters(band=20.0, every=10**9)
    sim = simulate(box, specs, x, 2, adaptation=adaptation, capacity=4 * len(x))
    assert sim.counts()[0] > 2 * len(x)
    assert sim.particles.numpy("density").max() < 1001.0
