"""The ledger against sums by hand, and its alarms."""

import numpy as np
import pytest

from msph.fluid.classic import ClassicTerms
from msph.fluid.forcing import Forcing
from msph.fluid.layers import LayerSpec
from msph.fluid.simulation import Simulation
from msph.measure.ledger import Ledger, NotFiniteError

G = (0.0, -9.81, 0.0)
SIZE = (1.0, 1.0, 1.0)
MASSES = np.array([0.3, 0.7])


@pytest.fixture(scope="module")
def world():
    rng = np.random.default_rng(5)
    n = 60
    initial = {
        "x": rng.uniform(0.2, 0.8, (n, 3)).astype(np.float32),
        "v": rng.normal(0.0, 1.0, (n, 3)).astype(np.float32),
        "layer": rng.integers(0, 2, n).astype(np.int32),
    }
    layers = [LayerSpec(m, 1000.0, 2.0, viscosity=1.0) for m in MASSES]
    sim = Simulation(SIZE, layers, initial, ClassicTerms())
    return sim, Ledger(sim)


@pytest.fixture(autouse=True)
def start_anew(world):
    world[0].reset()
    world[1].clear()


def test_entry_equals_sums_by_hand(world):
    sim, ledger = world
    density = np.linspace(800.0, 1300.0, sim.particles.count)
    sim.particles.fill(**{**sim.particles.state(), "density": density})
    entry = ledger.record(G)
    x, v = (sim.particles.numpy(k).astype(float) for k in "xv")
    m = MASSES[sim.particles.numpy("layer")]
    assert entry.mass == pytest.approx(m.sum(), rel=1e-5)
    assert entry.momentum == pytest.approx((m[:, None] * v).sum(axis=0), rel=1e-4, abs=1e-4)
    assert entry.kinetic == pytest.approx(0.5 * (m * (v**2).sum(axis=1)).sum(), rel=1e-5)
    assert entry.potential == pytest.approx((m * 9.81 * x[:, 1]).sum(), rel=1e-5)
    assert entry.density_error_max == pytest.approx(0.3, rel=1e-4)
    assert entry.density_error_mean == pytest.approx(
        np.maximum(density / 1000.0 - 1.0, 0.0).mean(), rel=1e-4
    )
    assert entry.outside == 0


def test_turning_gravity_is_work_and_not_energy(world):
    sim, ledger = world
    before = ledger.record(G)
    after = ledger.record((3.0, -9.3, 0.0))
    assert after.potential != pytest.approx(before.potential, rel=1e-2)
    assert after.energy == pytest.approx(before.energy, rel=1e-4)
    assert ledger.energy_gain() < 1e-4


def test_gained_energy_is_seen(world):
    sim, ledger = world
    first = ledger.record(G)
    state = sim.particles.state()
    sim.particles.fill(**{**state, "v": 2.0 * state["v"]})
    ledger.record(G)
    expected = 3.0 * first.kinetic / (first.kinetic + first.potential)
    assert ledger.energy_gain() == pytest.approx(expected, rel=1e-3)


def test_particles_that_are_not_finite_are_an_error(world):
    sim, ledger = world
    state = sim.particles.state()
    state["v"][3] = np.nan
    state["x"][7] = np.inf
    sim.particles.fill(**state)
    with pytest.raises(NotFiniteError, match="2 of 60 particles are not finite"):
        ledger.record(G)


def test_particles_outside_the_box_are_counted(world):
    sim, ledger = world
    state = sim.particles.state()
    state["x"][:4, 1] = 1.5
    sim.particles.fill(**state)
    assert ledger.record(G).outside == 4


def test_momentum_drift_is_the_impulse_of_pair_forces(world):
    """Without gravity and before any wall is met, all momentum gained is drift."""
    sim, ledger = world
    start = ledger.record((0.0, 0.0, 0.0))
    sim.solver.step(1e-4, Forcing(gravity=(0.0, 0.0, 0.0)))
    entry = ledger.record((0.0, 0.0, 0.0))
    gained = entry.momentum - start.momentum
    assert np.linalg.norm(gained) > 0.0
    assert entry.internal_impulse == pytest.approx(gained, rel=1e-2, abs=1e-3)
