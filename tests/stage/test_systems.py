"""Tests that systems 1 to 3 of the thesis stay finite and in the box for 4 s of `pool`."""

import math

import pytest

from msph.scene import load_scene
from msph.stage.headless import Headless
from msph.stage.loop import run
from msph.stage.row import Row
from msph.stage.show import Show


@pytest.mark.slow
@pytest.mark.parametrize("system", ["system-1", "system-2", "system-3"])
def test_system_stays_finite_and_in_its_box_for_four_seconds(system):
    """All particles stay in the box, and the ledger raises an error if values are not finite."""
    scene = load_scene("pool", (f"variant={system}", "method=classic", "sway.angle=0"))
    show = Show(scene, 1 / 30, density_every=math.inf)
    run(Row([show]), Headless(120))
    last = show.ledger.entries[-1]
    assert last.time == pytest.approx(4.0)
    assert all(e.outside == 0 for e in show.ledger.entries)
    # Speeds well below the speed of sound, 14 m/s, show that the simulation is stable.
    assert max(e.top_speed for e in show.ledger.entries[60:]) < 5.0
    assert last.mass == pytest.approx(show.ledger.entries[0].mass, rel=1e-6)
