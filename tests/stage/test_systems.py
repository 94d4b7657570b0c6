"""Systems 1 to 3 of the thesis stay finite and in the box: `pool` whole, `pool_2x` falling in."""

import pytest

from msph.scene import load_scene
from msph.stage.loop import run
from msph.stage.null import Nobody
from msph.stage.show import Show


@pytest.mark.parametrize("system", ["system-1", "system-2", "system-3"])
@pytest.mark.parametrize(("pool", "seconds"), [("pool", 10.0), ("pool_2x", 2.0)])
def test_system_stays_finite_and_in_its_box(pool, seconds, system):
    """The ledger raises for what is not finite. System 2 may oscillate in the deep pool."""
    show = Show(load_scene(pool, (f"variant={system}", "method=classic", "sway.angle=0")), 1 / 30)
    run(show, Nobody(round(30 * seconds)))
    last = show.ledger.entries[-1]
    assert last.time == pytest.approx(seconds)
    assert all(e.outside == 0 for e in show.ledger.entries)
    # Well under the speed of sound, 14 m/s: nothing explodes.
    assert max(e.top_speed for e in show.ledger.entries[len(show.ledger.entries) // 2 :]) < 5.0
    assert last.mass == pytest.approx(show.ledger.entries[0].mass, rel=1e-6)
