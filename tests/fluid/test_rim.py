"""Open boxes: water above the rim leaves over the side walls and is recorded."""

import numpy as np
import pytest

from msph.fluid.boundary.rim import AllSpiltError
from msph.fluid.classic_parameters import ClassicParameters
from msph.fluid.external_forces import ExternalForces
from msph.fluid.particles.layers import LayerSpec
from msph.fluid.projection.parameters import ProjectionParameters
from msph.fluid.simulation import Simulation
from msph.measure.ledger import Ledger
from msph.scene import load_scene
from msph.scene.build import build_simulation
from tests.fluid.fluid_kit import (
    FRAME,
    SPLASH,
    block_of,
    images_of,
    imbalance,
    neighbours_of,
    parts,
    place,
    record,
    simulate,
)

SIZE, SPACING = (0.4, 0.3, 0.4), 0.04
# Gravity in a box tilted by 40 degrees.
TILTED = ExternalForces((6.3, -7.5, 0.0))


def tank(height: float, method=ProjectionParameters, v=None, x=None) -> Simulation:
    """Returns an open box with water of `height` [m], or with particles at x (n, 3) [m]."""
    smoothing = 2.45 if method is ProjectionParameters else 1.6
    layers = [LayerSpec(1000.0 * SPACING**3, 1000.0, smoothing, viscosity=5.0)]
    x = block_of((0.4, height, 0.4), SPACING) if x is None else x
    return simulate(SIZE, layers, x, v=v, terms=method(), open_top=True)


def run(sim: Simulation, frames: int, gravity=TILTED.gravity) -> Ledger:
    return record(sim, frames * FRAME, gravity)


@pytest.mark.parametrize("method", [ProjectionParameters, ClassicParameters])
def test_a_tilted_box_spills_and_loses_no_mass(method):
    sim = tank(0.24, method)
    ledger = run(sim, 30)
    first, last = ledger.entries[0], ledger.entries[-1]
    assert last.spilt > 0.1 * first.mass
    mass = 1000.0 * SPACING**3
    assert last.spilt == pytest.approx((len(sim.initial["x"]) - sim.particles.count) * mass)
    for entry in ledger.entries:
        assert entry.mass + entry.spilt == pytest.approx(first.mass, rel=1e-6)
        assert entry.outside == 0
    x, ids = sim.particles.numpy("x"), sim.particles.numpy("id")
    assert np.all(x[:, [0, 2]] > 0.0) and np.all(x[:, [0, 2]] < 0.4)
    assert len(np.unique(ids)) == sim.particles.count
    if method is ProjectionParameters:
        # The energy in the box plus the spilt energy hardly rises, and falls in total.
        assert last.spilt_energy != 0.0 and ledger.energy_gain() < 2e-3
        assert last.energy < first.energy


def test_water_rises_above_the_rim_and_falls_back():
    x = block_of((0.4, 0.16, 0.4), SPACING)
    v = np.zeros_like(x, dtype=np.float32)
    # Only water in the middle, away from the walls, moves upwards.
    v[np.all(np.abs(x[:, [0, 2]] - 0.2) < 0.1, axis=1), 1] = 3.0
    sim = tank(0.16, v=v)
    tops = []
    for _ in range(100):
        sim.advance(FRAME, ExternalForces())
        tops.append(sim.particles.numpy("x")[:, 1].max())
        assert sim.contact.leaked() == 0
    assert max(tops) > SIZE[1] + 0.05
    assert tops[-1] < SIZE[1]
    assert sim.rim.mass < 0.2 * len(v) * 1000.0 * SPACING**3


def test_momentum_leaves_with_the_water():
    """The momentum changes per step by the impulses of gravity, walls and pair forces less the
    spilt momentum. All but gravity, which acts on the water in the box, are recorded."""
    sim = tank(0.24)
    ledger = run(sim, 10)
    spilt = 0
    for _ in range(120):
        before, steps = ledger.entries[-1], sim.steps
        sim.advance(1e-3, TILTED)
        after = ledger.record(TILTED.gravity)
        if sim.steps - steps > 1:
            continue
        balance = imbalance(before, after, 1e-3, TILTED.gravity)
        assert np.linalg.norm(balance) < 1e-6 * before.mass * np.linalg.norm(TILTED.gravity)
        spilt += after.spilt > before.spilt
    assert spilt > 3


def test_neighbours_above_the_rim_are_complete_and_mutual():
    """Some particles are above the grid, and particles above the rim have no images."""
    rng = np.random.default_rng(3)
    x = rng.uniform((0.0, 0.2, 0.0), (0.4, 0.7, 0.4), (400, 3)).astype(np.float32)
    sim = tank(0.2, x=x)
    place(sim, x=x, v=np.zeros_like(x))
    x = sim.particles.numpy("x")
    reach = parts(sim).neighbours.reaches[0, 0]
    distance = np.linalg.norm(x[:, None] - x[None], axis=2)
    for i, ours in enumerate(neighbours_of(sim)):
        assert set(ours) == set(np.flatnonzero(distance[i] < reach).tolist()) - {i}
    images = images_of(sim)
    assert images
    for i, j, mirrors in images:
        assert x[i, 1] <= SIZE[1] and x[j, 1] <= SIZE[1]
        assert (j, i, mirrors) in images


def test_water_spills_from_adaptive_layers():
    """Mass is conserved and ids stay unique while particles split, merge and are spilt."""
    sim = build_simulation(load_scene("drop", (*SPLASH, "box.open=true")))
    mass = run(sim, 1).entries[0].mass
    last = run(sim, 40).entries[-1]
    assert last.spilt > 0.0
    assert last.mass + last.spilt == pytest.approx(mass, rel=1e-6)
    assert sum(sim.solver.adaptation.totals) > 0
    assert len(np.unique(sim.particles.numpy("id"))) == sim.particles.count


def test_water_that_never_returns_is_spilt():
    sim = tank(0.08)
    with pytest.raises(AllSpiltError):
        run(sim, 90, (0.0, 20.0, 0.0))
    assert sim.rim.mass == pytest.approx(len(sim.initial["x"]) * 1000.0 * SPACING**3)


def test_drops_fall_to_the_ground_and_vanish():
    sim = tank(0.24)
    run(sim, 20)
    live = sim.rim.drops.life.to_numpy() > 0.0
    assert live.sum() > 10
    down = np.array(TILTED.gravity)
    lowest = np.abs(down) @ np.array(SIZE) / 2.0
    x = sim.rim.drops.x.to_numpy()[live]
    assert np.all((x - np.array(SIZE) / 2.0) @ down <= 1.01 * lowest)
    for _ in range(120):
        sim.rim.fall(FRAME, TILTED.gravity)
    assert not (sim.rim.drops.life.to_numpy() > 0.0).any()
