"""A body that traps water is reported by its name, and is stopped if stop_bodies is set."""

import numpy as np
import pytest

from msph.fluid.boundary.opening import Opening, Valve
from msph.fluid.trapped_water import TrappedWaterError
from msph.scene import build_simulation
from msph.stage.headless import Headless
from msph.stage.loop import run
from msph.stage.row import Row
from msph.stage.show import Show
from tests.fluid.fluid_kit import GRAVITY, WEIGHTLESS, advance, in_order, ledger_of
from tests.scenes_kit import load

# A piston as wide as the box, above a ball at rest in the water.
PISTON = """
[box]
size = [0.24, 0.4, 0.24]
[[layers]]
spacing = 0.04
[[water]]
lo = [0, 0, 0]
hi = [0.24, 0.2, 0.24]
[[bodies]]
centre = [0.12, 0.06, 0.12]
radius = 0.04
[[bodies]]
lo = [0, 0.21, 0]
hi = [0.24, 0.38, 0.24]
"""
MOTIONS = {
    "slow": ("bodies.1.velocity=[0, -0.05, 0]",),
    "swinging": ("bodies.1.swing=[0, -0.2, 0]", "bodies.1.period=2"),
    "fast": ("bodies.1.velocity=[0, -2, 0]",),
}


def test_piston_without_a_gap_is_reported_by_name(tmp_path):
    sim = build_simulation(load(tmp_path, PISTON, *MOTIONS["fast"]))
    with pytest.raises(TrappedWaterError, match=r"bodies\.1 compresses water that cannot flow"):
        advance(sim, 120)


def test_water_thrown_at_a_wall_beside_a_slow_body_is_not_trapped(tmp_path):
    """Regression: without gravity, pressures were compared with the speed of the body alone."""
    thrown = ("gravity=[0, 0, 0]", "bodies.0.spin=1e-100", "water.0.velocity=[2, 0, 0]")
    sim = build_simulation(load(tmp_path, PISTON, *thrown))
    advance(sim, 15, WEIGHTLESS)
    assert sim.particles.numpy("pressure").max() > 0.0


def test_piston_over_half_of_the_box_traps_no_water(tmp_path):
    room = ("bodies.1.hi=[0.12, 0.38, 0.24]", "bodies.1.velocity=[0, -0.5, 0]")
    sim = build_simulation(load(tmp_path, PISTON, *room))
    advance(sim, 15)
    assert sim.particles.numpy("x")[:, 1].max() > 0.22


@pytest.mark.parametrize("motion", MOTIONS)
def test_piston_is_stopped_by_stop_bodies_and_no_water_is_lost(tmp_path, motion):
    """Regression: without room the water gained energy in bursts of up to 25 kJ."""
    show = Show(load(tmp_path, PISTON, *MOTIONS[motion]), 1 / 60, stop_bodies=True)
    count = show.simulation.particles.count
    run(Row([show]), Headless(90))
    assert show.stopped == {"bodies.1"}
    assert show.warnings() == ["bodies.1 stopped: it had trapped water"]
    last = show.ledger.entries[-1]
    assert show.simulation.particles.count == count and last.outside == 0
    assert last.time > 0.5
    assert np.isfinite(show.simulation.particles.numpy("x")).all()
    assert np.linalg.norm(show.simulation.particles.numpy("v"), axis=1).max() < 1.0
    show.reset()
    assert not show.stopped and not show.warnings()


def test_a_frame_that_is_undone_leaves_no_trace_in_the_ledger(tmp_path):
    """Regression: water that had left through outflows, or had entered in the frame, was forgotten
    or counted twice, so that the mass changed by up to 60 %."""
    sim = build_simulation(load(tmp_path, PISTON, *MOTIONS["slow"]))
    ledger = ledger_of(sim)
    advance(sim, 3)
    spout = Opening(
        np.array([0.05, 0.0, 0.05]), np.array([0.0, 1.0, 0.0]), (0.03, 0.03), True, Valve(0.5)
    )
    sim.add_opening(spout, GRAVITY)
    sim._take_out(np.arange(3, dtype=np.int32), GRAVITY)
    advance(sim, 3)
    before, mark = ledger.record(GRAVITY), sim.mark()
    advance(sim, 6)
    sim._take_out(np.arange(2, dtype=np.int32), GRAVITY)
    after = ledger.record(GRAVITY)
    assert before.inflow_mass > 0.0 and after.outflow_mass > before.outflow_mass > 0.0
    assert not np.array_equal(after.body_impulse, before.body_impulse)
    sim.undo(mark)
    again = ledger.record(GRAVITY)
    for name, value in vars(before).items():
        assert np.allclose(getattr(again, name), value, rtol=1e-6, atol=1e-9, equal_nan=True), name


def test_an_undo_restores_particles_and_bodies_wherever_they_were(tmp_path):
    """Regression: a frame could not be undone while a particle was far outside the box, since
    checkpoint files with such particles are refused; the session ended."""
    sim = build_simulation(load(tmp_path, PISTON, *MOTIONS["slow"]))
    state = sim.particles.state()
    state["x"][0] = (0.1, -1.0, 0.1)
    sim.particles.fill(**state)
    before, mark = in_order(sim.particles, "x"), sim.mark()
    sim.particles.fill(**{**state, "x": state["x"] + np.float32(0.01)})
    sim.undo(mark)
    assert np.array_equal(in_order(sim.particles, "x"), before)
    with pytest.raises(ValueError, match="particles outside the box"):
        sim.restore(mark.state)


def test_a_body_at_rest_without_gravity_traps_no_water(tmp_path):
    """Regression: ZeroDivisionError where neither gravity nor a body could cause a speed."""
    still = ("gravity=[0, 0, 0]", "bodies.1.angle=30")
    place = ("bodies.1.lo=[0.08, 0.1, 0.08]", "bodies.1.hi=[0.16, 0.16, 0.16]")
    sim = build_simulation(load(tmp_path, PISTON, *still, *place))
    advance(sim, 2, WEIGHTLESS)
    assert np.isfinite(sim.particles.numpy("x")).all()
