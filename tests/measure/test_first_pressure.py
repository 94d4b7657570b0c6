"""Tests of the pressures before the first step, against theory."""

import numpy as np
import pytest

import msph
from msph.measure.probes import PressureProbe
from msph.measure.snapshot import Snapshot

RHO_G = 9810.0
CORNER = (0.0, 0.0, 0.0)


def beside_a_free_face(depth, length):
    """Returns the pressure [Pa] at the foot of a wall at which a column of water of this depth and
    length [m] is released on the other side: rho g (H - sum 2/(H k^2 cosh kL)), k = (n + 1/2) pi/H,
    the solution of Laplace's equation with p = 0 at both free faces."""
    k = (np.arange(50) + 0.5) * np.pi / depth
    return RHO_G * (depth - (2.0 / (depth * k**2 * np.cosh(k * length))).sum())


def first(scene, **changes):
    with msph.open(scene, quality="small", set=changes) as water:
        water.probe("pressure", point=CORNER)
        return water.frame.pressure


def test_a_corner_of_still_water_has_the_weight_of_its_depth():
    assert first("still") == pytest.approx(RHO_G * 0.32, rel=0.01)


def test_a_corner_of_a_dam_break_has_the_pressure_of_its_release():
    """Regression: the first reading was empty, and hydrostatic pressure would be 2.7 times it."""
    assert first("dam_break") == pytest.approx(beside_a_free_face(0.7, 0.35), rel=0.04)


def test_the_pressures_follow_inertia_and_leave_the_water_as_it_is():
    """Water that is pushed along x at 3 m/s^2 presses more on the wall behind it."""
    motion = {"motion": [{"displacement": ["0.5 * 3 * t * t", 0, 0]}]}
    with msph.open("still", quality="small", set=motion) as water:
        before = water.frame.particles
        water.probe("pressure", point=CORNER)
        assert water.frame.pressure > RHO_G * 0.32 * 1.1
        assert all(np.array_equal(a, b) for a, b in zip(before, water.frame.particles, strict=True))


def test_no_pressures_are_found_without_a_probe_that_reads_them(monkeypatch):
    read = []
    monkeypatch.setattr(PressureProbe, "read", lambda self, water: read.append(water) or [0.0])
    with msph.open("still", quality="small") as water:
        assert isinstance(water._show.snapshot([]), Snapshot)
        assert water._show.snapshot([]).pressure is None
        water.probe("pressure", point=CORNER)
        assert water.frame.pressure == 0.0 and read[0].pressure is not None
