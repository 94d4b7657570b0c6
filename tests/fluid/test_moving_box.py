"""A moving box: free motion is straight in the world, and the ledger balances."""

import math
from functools import partial

import numpy as np
import pytest

from bench import tanks
from msph.fluid.boundary.rigid_bodies import Block, Motion, rotations
from msph.fluid.classic_parameters import ClassicParameters
from msph.fluid.moving_box import MovingBox
from msph.fluid.projection.parameters import ProjectionParameters
from tests.fluid.fluid_kit import GRAVITY, block_of, imbalance, simulate, spec_of

SIZE = (0.6, 0.6, 0.6)
CENTRE = 0.5 * np.array(SIZE)
D = 0.04
AXIS = np.array([0.6, 0.0, 0.8])


def path(time):
    """Returns the shift [m] and the rotation of a box that surges, and rotates from rest about an
    axis oblique to its edges."""
    shift = np.array([0.03 * math.sin(5.0 * time), 0.2 * time**2, 0.0])
    return shift, rotations(1.5 * (1.0 - math.cos(2.0 * time)) * AXIS[None])[0]


@pytest.mark.parametrize("parameters", [ProjectionParameters(), ClassicParameters()])
def test_a_free_particle_falls_straight_in_the_world(parameters):
    """The particle starts at rest in the box, with the velocity of the box."""
    start = np.array([0.35, 0.4, 0.3])
    sim = simulate(SIZE, [spec_of(D)], start[None], terms=parameters)
    entries = tanks.recorded(sim, 12 / 60, partial(MovingBox, GRAVITY, path)).entries
    first, last = entries[0], entries[-1]
    speed = np.array([0.03 * 5.0, 0.0, 0.0])
    expected = start + speed * sim.time + 0.5 * np.array(GRAVITY) * sim.time**2
    shift, turned = path(sim.time)
    seen = CENTRE + turned @ (sim.particles.numpy("x")[0] - CENTRE) + shift
    unturned = CENTRE + turned @ (start - CENTRE) + shift
    assert np.linalg.norm(expected - unturned) > 0.1
    assert seen == pytest.approx(expected, abs=3e-3)
    # The particle gains energy only by the work of gravity and inertia.
    assert last.inertia_work != 0.0 and last.user_work == 0.0
    assert last.energy == pytest.approx(first.energy, abs=2e-2 * last.kinetic)


def test_water_in_a_moving_box_balances_momentum_and_gains_no_energy():
    """In a box that surges and rotates about the vertical, momentum changes by the recorded
    impulses and the energy rises by less than 0.16 J."""

    def moving(time):
        return path(time)[0], rotations(np.array([[0.0, 4.0 * time, 0.0]]))[0]

    sim = simulate(SIZE, [spec_of(D)], block_of((0.6, 0.24, 0.6), D))
    ledger = tanks.recorded(sim, 40 / 60, partial(MovingBox, GRAVITY, moving))
    first, last = ledger.entries[0], ledger.entries[-1]
    scale = last.mass * 9.81 * sim.time
    assert np.abs(imbalance(first, last, sim.time)).max() < 1e-6 * scale
    assert np.abs(last.inertia_impulse).max() > 1e-3 * scale
    # The first ten frames, in which the initial lattice settles, are left out.
    energies = np.array([e.energy for e in ledger.entries[10:]])
    assert max(e.inertia_work for e in ledger.entries) > 1.0
    assert (energies - np.minimum.accumulate(energies)).max() < 0.16


def test_a_floating_body_without_forces_moves_straight_and_turns_freely_in_the_world():
    """Far from the water, the angular momentum of a body is conserved in the world, and its kinetic
    energy in the box changes by the work of inertia."""
    lo, hi = np.array([0.2, 0.3, 0.2]), np.array([0.3, 0.36, 0.34])
    body = Block(lo, hi, Motion((0.3, 0.2, 0.0), axis=(1, 2, 0), rate=3.0), mass=0.5)
    sim = simulate(SIZE, [spec_of(D)], np.array([[0.5, 0.05, 0.5]]), bodies=(body,))
    floating, weightless = sim.boundary.floating, (0.0, 0.0, 0.0)
    first = floating.x[0] - CENTRE, floating.v[0].copy(), floating.spin_momentum[0].copy()
    # The box does not rotate at the start.
    energy = floating.kinetic()
    for _ in range(30):
        sim.advance(1 / 120, MovingBox(weightless, path, sim.time))
    shift, turned = path(sim.time)
    seen = turned @ (floating.x[0] - CENTRE) + shift
    straight = first[0] + (first[1] + [0.03 * 5.0, 0.0, 0.0]) * sim.time
    assert seen == pytest.approx(straight, abs=1e-3)
    dt, inertia = 1e-4, floating.turn @ floating.inertia @ floating.turn.transpose(0, 2, 1)
    ahead = path(sim.time + dt)[1] @ turned.T
    rate = np.linalg.norm(ahead - ahead.T) / math.sqrt(8.0) / dt
    spin = turned @ (floating.spin_momentum[0] + inertia[0] @ (turned.T @ (rate * AXIS)))
    assert spin == pytest.approx(first[2], abs=1e-2 * np.linalg.norm(first[2]))
    work = floating.inertia_work
    assert abs(work) > 0.1 * energy
    assert floating.kinetic() - energy == pytest.approx(work, rel=2e-2)


def test_a_freely_falling_box_has_no_pressure():
    sim = simulate(SIZE, [spec_of(D)], block_of((0.6, 0.24, 0.6), D))

    def fall(time):
        return np.array([0.0, -0.5 * 9.81 * max(time - 0.2, 0.0) ** 2, 0.0]), np.eye(3)

    pressures = []
    for _ in range(24):
        sim.advance(1 / 60, MovingBox(GRAVITY, fall, sim.time))
        pressures.append(np.abs(sim.particles.numpy("pressure")).mean())
    assert pressures[11] > 500.0 and pressures[-1] < 5.0
