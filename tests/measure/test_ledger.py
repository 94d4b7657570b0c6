"""Tests of the ledger: entries against sums by hand, balances, and the errors it reports."""

import dataclasses
import math

import numpy as np
import pytest

from msph.fluid.classic_parameters import ClassicParameters
from msph.fluid.external_forces import ExternalForces, Hand
from msph.fluid.particles.layers import LayerSpec
from msph.fluid.projection.parameters import ProjectionParameters
from msph.fluid.simulation import FullError
from msph.measure.entry import Entry
from msph.measure.ledger import Ledger, NotFiniteError, level_potential
from msph.measure.summary import errors
from msph.measure.table import column
from msph.scene import load_scene
from msph.scene.build import build_simulation
from msph.scene.schema import Scene
from tests.fluid.fluid_kit import advance, imbalance, lattice, poly6, simulate, spec_of, vectors

G = (0.0, -9.81, 0.0)
SIZE = (1.0, 1.0, 1.0)
MASSES = np.array([0.3, 0.7])


@pytest.fixture(scope="module")
def shared():
    rng = np.random.default_rng(5)
    n = 60
    x, v = rng.uniform(0.2, 0.8, (n, 3)), rng.normal(0.0, 1.0, (n, 3))
    layers = [LayerSpec(m, 1000.0, 2.0, viscosity=1.0) for m in MASSES]
    sim = simulate(SIZE, layers, x, rng.integers(0, 2, n), v, ClassicParameters())
    return sim, Ledger(sim)


@pytest.fixture
def world(shared):
    sim, ledger = shared
    sim.reset()
    ledger.clear()
    return sim, ledger


@pytest.fixture
def pool():
    """Returns a pool of the projection method, 448 particles in two layers, and its ledger."""
    d = 0.05
    x = lattice((8, 7, 8), d)
    layers = [spec_of(d, 2.0), LayerSpec(1050.0 * d**3, 1000.0, 2.0)]
    sim = simulate((8 * d, 10 * d, 8 * d), layers, x, x[:, 1] < 4 * d)
    return sim, Ledger(sim)


# The next tests run before `world` is built, and use its fields.
def test_motion_energy_is_the_energy_above_level_water():
    """The reference is level water, half as high as a block on half of the floor; a body of
    0.08 m^3 raises it from 0.4 to 0.48 m."""
    half = [0.5, 0.8, 1.0]
    scene = {
        "method": "projection",
        "box": {"size": SIZE},
        "layers": [{"mass": 1000.0 * 0.1**3}],
        "water": [{"layer": 0, "lo": [0, 0, 0], "hi": half}],
    }
    block = build_simulation(Scene.model_validate(scene))
    ledger = Ledger(block, density_every=math.inf)
    entry = ledger.record(G)
    mass, weight = 1000.0 * np.prod(half), 9810.0 * np.prod(half)
    assert level_potential(block, np.array(G), mass) == pytest.approx(weight * 0.2, rel=1e-6)
    assert ledger.motion_energy() == pytest.approx(entry.potential - weight * 0.2, rel=1e-4)
    block.close()
    scene["bodies"] = [{"lo": [0.6, 0.0, 0.0], "hi": [1.0, 0.2, 1.0]}]
    block = build_simulation(Scene.model_validate(scene))
    # 0.12 m^3 fill the room next to the body up to 0.2 m; 0.28 m^3 lie above, 0.28 m high.
    expected = 9810.0 * (0.12 * 0.1 + 0.28 * (0.2 + 0.14))
    found = level_potential(block, np.array(G), mass)
    assert found == pytest.approx(expected, rel=1e-2)


def test_fine_water_is_not_added_between_coarse_particles():
    """Regression: fine water was added in the gaps of coarse water and blew up."""
    scene = load_scene("deep", ("method=projection",))
    sim = build_simulation(scene, 2000)
    finest = int(np.argmin([s.mass for s in sim.layers.specs]))
    coarse = sim.particles.numpy("layer") == int(np.argmax([s.mass for s in sim.layers.specs]))
    x = sim.particles.numpy("x")[coarse]
    middle = x[np.abs(x - 0.5 * (x.min(axis=0) + x.max(axis=0))).sum(axis=1).argmin()]
    rng = np.random.default_rng(1)
    sites = (middle + rng.uniform(-0.2, 0.2, (200, 3))).astype(np.float32)
    assert sim.add(sites, np.zeros_like(sites), finest, G) == 0


@pytest.mark.parametrize("tension", [0.0, 0.072])
def test_energy_gains_are_unknown_under_surface_tension(tension):
    """Regression: the energy that the surface gave to drops counted as created by the method."""
    x, terms = lattice((4, 4, 4), 1e-3) + 7.5e-3, ProjectionParameters(tension=tension)
    sim = simulate((0.02,) * 3, [spec_of(1e-3)], x, terms=terms)
    ledger = Ledger(sim)
    for _ in range(3):
        ledger.record((0.0, 0.0, 0.0))
        sim.advance(1e-3, ExternalForces((0.0, 0.0, 0.0)))
    found = errors(ledger, [])
    names = ("energy_gain", "energy_gain_of_motion", "energy_rise_in_1_s")
    assert all(math.isnan(found[name]) for name in names) == (tension > 0.0)


def test_added_water_is_recorded_and_overlaps_nothing(pool, monkeypatch):
    sim, ledger = pool
    monkeypatch.setattr(sim.particles, "capacity", sim.particles.count + 3)
    start, d = ledger.record(G), 0.05
    above = np.array([[0.1, 0.4, 0.1], [0.2, 0.42, 0.2], [0.3, 0.45, 0.3]], np.float32)
    # Not added: in the water, beyond a wall, and next to an added particle.
    inside = np.array([[0.11, 0.12, 0.1], [-0.1, 0.4, 0.1], [0.12, 0.4, 0.1]], np.float32)
    x = np.concatenate([above, inside])
    v = np.tile(np.array([0.4, -1.0, 0.2], np.float32), (len(x), 1))
    assert sim.add(x, v, 0, G) == 3
    after = ledger.record(G)
    assert after.added_mass == pytest.approx(3000.0 * d**3, rel=1e-6)
    assert after.mass - start.mass == pytest.approx(after.added_mass, rel=1e-3)
    assert ledger.mass_change() == pytest.approx(0.0, abs=1e-6)
    gained = after.momentum - start.momentum
    assert gained == pytest.approx(after.user_impulse, abs=1e-4) and gained[0] > 0.1
    assert after.energy == pytest.approx(start.energy, abs=1e-4 * start.potential)
    ids = sim.particles.numpy("id")
    assert len(np.unique(ids)) == len(ids)
    with pytest.raises(FullError, match="full"):
        sim.add(above + np.float32(0.051), v[:3], 0, G)
    advance(sim, 6)
    entry = ledger.record(G)
    assert abs(ledger.mass_change()) < 1e-6 and entry.outside == 0
    assert entry.energy < start.energy + 1e-3 * start.potential
    sim.reset()
    assert ledger.record(G).added_mass == 0.0


@pytest.mark.parametrize("name", ["pool", "world"])
def test_momentum_is_the_impulse_of_gravity_walls_and_the_hand(name, request):
    """Particles fall, are dragged and hit walls."""
    sim, ledger = request.getfixturevalue(name)
    start = ledger.record(G)
    hand = Hand(
        position=(0.2, 0.2, 0.2),
        velocity=(2.0, 1.0, -1.0),
        radii=(0.25, 0.25, math.inf),
        grip=20.0,
        spin=(0.0, 5.0, 0.0),
        draw=-3.0,
    )
    for _ in range(12):
        sim.advance(1 / 60, ExternalForces(G, hand))
    entry = ledger.record(G)
    exchanged = entry.mass * 9.81 * sim.time
    assert np.abs(imbalance(start, entry, sim.time)).max() < 1e-4 * exchanged
    assert entry.user_impulse[0] > 0.01 * exchanged and entry.user_work != 0.0
    assert np.linalg.norm(entry.wall_impulse) > 0.1 * exchanged
    assert entry.wall_work == entry.merge_loss == 0.0
    if name == "pool":
        assert ledger.momentum_drift() < 1e-4
        assert np.linalg.norm(entry.internal_impulse) < 1e-5 * exchanged


def test_entry_equals_sums_by_hand(world):
    """Sums over particles, four of which are outside the box; angular momentum is about the origin,
    its scale about the middle of the box."""
    sim, ledger = world
    state = sim.particles.state()
    state["x"][:4, 1] = 1.5
    sim.particles.fill(**state)
    entry = ledger.record(G)
    x, v = vectors(sim)
    m = MASSES[sim.particles.numpy("layer")]
    assert entry.mass == pytest.approx(m.sum(), rel=1e-5)
    assert entry.momentum == pytest.approx((m[:, None] * v).sum(axis=0), rel=1e-4, abs=1e-4)
    assert entry.kinetic == pytest.approx(0.5 * (m * (v**2).sum(axis=1)).sum(), rel=1e-5)
    assert entry.potential == pytest.approx((m * 9.81 * x[:, 1]).sum(), rel=1e-5)
    scale = m @ (np.linalg.norm(x - 0.5, axis=1) * np.linalg.norm(v, axis=1))
    assert entry.angular_scale == pytest.approx(scale, rel=1e-6)
    assert np.abs(entry.angular_momentum - m @ np.cross(x, v)).max() < 1e-6 * scale
    assert entry.outside == 4


def test_turning_gravity_counts_as_work_and_not_as_energy(world):
    sim, ledger = world
    before = ledger.record(G)
    after = ledger.record((3.0, -9.3, 0.0))
    assert after.potential != pytest.approx(before.potential, rel=1e-2)
    assert after.energy == pytest.approx(before.energy, rel=1e-4)
    assert ledger.energy_gain() < 1e-4


def test_energy_gain_equals_the_energy_added(world):
    sim, ledger = world
    first = ledger.record(G)
    state = sim.particles.state()
    sim.particles.fill(**{**state, "v": 2.0 * state["v"]})
    ledger.record(G)
    expected = 3.0 * first.kinetic / (first.kinetic + first.potential)
    assert ledger.energy_gain() == pytest.approx(expected, rel=1e-3)


def test_particles_that_are_not_finite_raise_an_error(world):
    sim, ledger = world
    state = sim.particles.state()
    state["v"][3] = np.nan
    state["x"][7] = np.inf
    sim.particles.fill(**state)
    with pytest.raises(NotFiniteError, match="2 of 60 particles are not finite.* of layer .*nan"):
        ledger.record(G)


def test_density_errors_refer_to_the_positions_at_the_end_of_a_frame(world):
    """The last step summed densities at earlier positions."""
    sim, ledger = world
    state = sim.particles.state()
    state["x"] = (0.5 + 0.28 * (state["x"] - 0.5)).astype(np.float32)
    sim.particles.fill(**state)
    sim.solver.reset()
    sim.advance(2e-3, ExternalForces())
    assert np.linalg.norm(sim.particles.numpy("v"), axis=1).max() > 1.0
    entry = ledger.record(G)
    x, layer = sim.particles.numpy("x").astype(float), sim.particles.numpy("layer")
    h = np.array([s.support for s in sim.layers.specs])[layer]
    r = np.linalg.norm(x[:, None] - x, axis=2)
    excess = np.maximum((MASSES[layer] * poly6(r, h)).sum(axis=1) / 1000.0 - 1.0, 0.0)
    assert excess.max() > 0.1
    found = entry.solver_residual_mean, entry.solver_residual_p99, entry.solver_residual_max
    expected = excess.mean(), np.percentile(excess, 99.0), excess.max()
    assert found == pytest.approx(expected, rel=1e-3)
    assert ledger.solver_residual() == pytest.approx(expected, rel=1e-3)
    assert np.isnan(Ledger(sim, density_every=math.inf).record(G).solver_residual_max)


def test_a_row_has_a_number_for_every_column(world):
    row, heads = world[1].record(G).row(), Entry.columns()
    assert len(row) == len(heads) == len({column(head) for head in heads})
    assert all(column(head).isidentifier() for head in heads)
    by_head = dict(zip(heads, row, strict=True))
    assert by_head["gravity_y [m/s^2]"] == -9.81
    assert by_head["mass [kg]"] == world[1].entries[-1].mass
    assert "kinetic [J]" in heads and "angular_momentum_z [kg m^2/s]" in heads


def with_energies(world, kinetic, gravity=None, user=None):
    """Returns the ledger with entries 0.4 s apart that have these kinetic energies [J] and, if
    given, these gravities [m/s^2] and x components of the user's impulse [N s]."""
    sim, ledger = world
    first = ledger.record(G)
    for k, energy in enumerate(kinetic):
        g = first.gravity if gravity is None else np.array(gravity[k])
        impulse = np.zeros(3) if user is None else np.array([user[k], 0.0, 0.0])
        changes = {"time": 0.4 * k, "kinetic": energy, "gravity": g, "user_impulse": impulse}
        ledger.entries.append(dataclasses.replace(first, **changes))
    del ledger.entries[0]
    return ledger


def test_energy_rise_is_the_largest_within_a_window(world):
    ledger = with_energies(world, [10.0, 4.0, 5.0, 7.0, 8.0, 1.0])
    assert ledger.energy_rise(1.0) * ledger.reference_energy() == pytest.approx(3.0)
    assert ledger.energy_rise(10.0) * ledger.reference_energy() == pytest.approx(4.0)
    assert ledger.energy_rise(0.4) * ledger.reference_energy() == pytest.approx(2.0)


def test_energy_from_input_is_no_energy_rise(world):
    """Rises with input do not count: the user pushes between the second and the third entry, and
    the box is tilted before the last entry."""
    tilt = [G, G, G, G, (1.0, -9.7, 0.0)]
    user = [0.0, 0.0, 2.0, 2.0, 2.0]
    ledger = with_energies(world, [5.0, 4.0, 9.0, 9.5, 20.0], tilt, user)
    assert ledger.energy_rise(1.0) * ledger.reference_energy() == pytest.approx(0.5)
    ledger.clear()
    ledger = with_energies(world, [1.0, 2.0, 3.0], user=[0.0, 1.0, 2.0])
    assert np.isnan(ledger.energy_rise(1.0))


def test_reference_energy_counts_height_above_the_lowest_corner(world):
    sim, ledger = world
    upside_down = ledger.record((0.0, 9.81, 0.0))
    height = 1.0 - upside_down.centre[1]
    expected = upside_down.kinetic + upside_down.mass * 9.81 * height
    assert ledger.reference_energy() == pytest.approx(expected, rel=1e-6)


def test_the_hands_work_is_the_energy_it_gives(world):
    sim, ledger = world
    state = sim.particles.state()
    far = {**state, "x": state["x"][:2], "v": state["v"][:2] * 0, "layer": state["layer"][:2]}
    far["x"] = np.array([[0.2, 0.5, 0.5], [0.8, 0.5, 0.5]], np.float32)
    sim.particles.fill(**{k: v[:2] for k, v in far.items()})
    sim.solver.reset()
    hand = Hand(
        position=(0.2, 0.5, 0.5), velocity=(1.0, 0.5, 0.0), radii=(0.3, 0.3, 0.3), grip=30.0
    )
    for _ in range(5):
        sim.solver.step(2e-3, ExternalForces((0.0, 0.0, 0.0), hand))
    entry = ledger.record((0.0, 0.0, 0.0))
    assert entry.kinetic > 1e-3
    assert entry.user_work == pytest.approx(entry.kinetic, rel=1e-4)
    assert entry.user_impulse == pytest.approx(entry.momentum, rel=1e-4)
    assert entry.energy == pytest.approx(0.0, abs=1e-4 * entry.kinetic)
