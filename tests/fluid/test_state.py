"""Steps that need not end with frames, and the water and bodies that a frame shows."""

import numpy as np
import pytest

from msph.fluid.boundary.rigid_bodies import Ball, Motion
from msph.fluid.external_forces import ExternalForces
from msph.state import Moment, state_of
from tests.fluid.fluid_kit import in_order, lattice, simulate, spec_of

D, FRAME = 0.04, 1 / 30
GRAVITY = np.array((0.0, -2.0, 0.0))
THROW = np.array((1.2, 0.5, 0.0))  # initial velocity of water and ball [m/s]
DRIVEN = np.array((0.3, 0.0, 0.4))  # velocity of the other ball [m/s]
START, DRIVEN_START = np.array((0.5, 0.6, 0.3)), np.array((0.3, 0.15, 0.3))


@pytest.fixture
def thrown():
    """A cube of water and a ball that fly freely, and a ball in prescribed motion."""
    floating = Ball(START, 0.08, Motion(tuple(THROW)), 1.0)
    bodies = [floating, Ball(DRIVEN_START, 0.08, Motion(tuple(DRIVEN)))]
    x = lattice((4, 4, 4), D, corner=(0.1, 0.4, 0.5))
    return simulate((1.6, 1.6, 0.9), [spec_of(D)], x, v=THROW, bodies=bodies)


def state_beside(sim):
    state = sim.world.build_once(state_of)
    state.load(sim.plan)
    return state


def centres(sim):
    return sim.boundary.centre.to_numpy()[:2, 1]


def test_free_steps_show_water_and_bodies_at_the_end_of_each_frame(thrown):
    """Free flight is exact at the end of steps; between them the way is straight."""
    sim, shown, ahead = thrown, state_beside(thrown), []
    (start,) = in_order(thrown.particles, "x")
    for frame in range(1, 13):
        t = frame * FRAME
        assert sim.advance(FRAME, ExternalForces(tuple(GRAVITY)), free=True) == FRAME
        assert sim.time == pytest.approx(t) and 0.0 <= sim.ahead < sim.last_step
        ahead.append(sim.ahead)
        before = sim.state()
        flown = THROW * t + 0.5 * GRAVITY * t * t
        straight = 0.5 * 2.0 * sim.last_step**2 + 1e-5
        shown.take(sim, Moment())
        with shown.at_frame():
            (x,) = in_order(shown.particles, "x")
            assert np.abs(x - start - flown).max() < straight
            found = centres(sim)
        assert np.abs(found[0] - START - flown).max() < straight
        assert found[1] == pytest.approx(DRIVEN_START + t * DRIVEN, abs=1e-6)
        # Showing a frame changes nothing.
        assert centres(sim)[1] == pytest.approx(DRIVEN_START + sim.reached * DRIVEN, abs=1e-6)
        assert all(np.array_equal(a, sim.state()[k]) for k, a in before.items())
    assert np.ptp(ahead) > 0.2 * sim.last_step


def test_free_steps_are_as_long_as_allowed(thrown):
    """Steps that end with frames are shorter; afterwards they end with frames again."""
    counts = []
    for free in (False, True):
        thrown.reset()
        for _ in range(12):
            thrown.advance(FRAME, ExternalForces(tuple(GRAVITY)), free=free)
        counts.append(thrown.steps)
    assert counts[1] < 0.9 * counts[0]
    assert thrown.ahead > 0.0
    thrown.advance(FRAME, ExternalForces(tuple(GRAVITY)))
    assert thrown.ahead == 0.0 and thrown.boundary.time == pytest.approx(thrown.time)


def test_shown_water_stays_in_the_box(thrown):
    """A particle that bounced within the step shown was not beyond the wall before."""
    sim, shown = thrown, state_beside(thrown)
    sim.particles.fill(
        x=np.float32([[0.001, 0.8, 0.45]]), v=np.float32([[2.0, 0.0, 0.0]]), layer=np.int32([0])
    )
    sim.ahead = 0.01
    shown.take(sim, Moment())
    with shown.at_frame():
        assert shown.particles.numpy("x")[0] == pytest.approx((0.0, 0.8, 0.45))
    sim.ahead = 0.0
