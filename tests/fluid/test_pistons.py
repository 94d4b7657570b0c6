"""Pistons (moving walls of the box): pressure at rest, momentum and energy."""

import numpy as np
import pytest

from msph.fluid.boundary.pistons import Stroke
from msph.fluid.external_forces import ExternalForces
from tests.fluid.fluid_kit import FRAME, GRAVITY, block_of, imbalance, ledger_of, simulate, spec_of

D = 0.05
SIZE, DEPTH = (0.8, 0.5, 0.25), 0.2
LOW, FAR = 1, 8  # walls normal to x


@pytest.fixture
def sim(request):
    """A pool with the spacing given by the test's parameter [m], by default D."""
    d = getattr(request, "param", D)
    return simulate(SIZE, [spec_of(d)], block_of((SIZE[0], DEPTH, SIZE[2]), d))


def run(sim, ledger, frames, speed=None):
    for _ in range(frames):
        if speed is not None:
            sim.piston.steer(sim.time, speed, FRAME)
        sim.advance(FRAME, ExternalForces(GRAVITY))
        ledger.record(GRAVITY)


@pytest.mark.parametrize("wall", [LOW, FAR])
def test_a_piston_at_its_wall_is_like_the_wall(sim, wall):
    """Regression: the wall mirrored particles as well, and the density there was 50 % too high."""
    ledger = ledger_of(sim)
    run(sim, ledger, 20)
    sim.add_piston(Stroke(wall))
    sim.measure_density()
    assert sim.particles.numpy("density").max() < 1060.0
    run(sim, ledger, 20)
    sim.remove_piston()
    run(sim, ledger, 10)
    before, after = ledger.entries[20], ledger.entries[-1]
    assert after.outside == 0 and after.wall_work == 0.0
    assert after.centre[0] == pytest.approx(before.centre[0], abs=0.03 * D)


# Energy gained by shear relief (-): water only four spacings deep gains 0.0049, eight 0.0011.
@pytest.mark.parametrize(("sim", "gain"), [(D, 6e-3), (0.5 * D, 3e-3)], indirect=["sim"])
def test_a_piston_pushes_the_water_by_its_work_and_impulse(sim, gain):
    ledger = ledger_of(sim)
    sim.add_piston(Stroke(LOW))
    run(sim, ledger, 12, 0.8)
    first, last = ledger.entries[0], ledger.entries[-1]
    place = sim.piston.at(sim.time)[0]
    assert place == pytest.approx(0.8 * 11.5 * FRAME)
    assert sim.particles.numpy("x")[:, 0].min() > place and last.outside == 0
    assert ledger.mass_change() == 0.0
    # The piston lifts the water in front of it and sets it in motion.
    assert last.centre[0] > first.centre[0] + 0.2 * place
    gained = last.mechanical - first.mechanical
    assert 0.7 * last.wall_work < gained < 1.001 * last.wall_work
    left = np.linalg.norm(imbalance(first, last, last.time))
    assert left < 1e-4 * first.mass * 9.81 * last.time
    assert last.body_impulse[0] > 0.0
    assert ledger.energy_gain() < gain


def test_a_removed_piston_has_no_effect_and_its_impulse_stays_in_the_ledger(sim):
    ledger = ledger_of(sim)
    sim.add_piston(Stroke(FAR))
    run(sim, ledger, 6, 0.5)
    pushed = ledger.entries[-1].body_impulse
    sim.remove_piston()
    assert sim.boundary.count == 0 and sim.piston is None
    sim.measure_density()
    assert not sim.particles.numpy("body_share").any()
    run(sim, ledger, 3)
    assert ledger.entries[-1].body_impulse == pytest.approx(pushed)
    sim.reset()
    fresh = ledger_of(sim)
    run(sim, fresh, 3)
    assert fresh.entries[-1].body_impulse == pytest.approx(np.zeros(3))
