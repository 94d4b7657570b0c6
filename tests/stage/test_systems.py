"""Systems 1 to 3 of the thesis, at a quarter of their footprint, stay finite for ten seconds.

bench/table_5_1.py runs them whole, and fails where the water does not stay finite.
"""

import pytest

from msph.scene import load_scene
from msph.stage.loop import run
from msph.stage.null import Nobody
from msph.stage.show import Show

# The pools at a quarter of their footprint keep depth, layers and constants; all walls are nearer.
SYSTEMS = ("system-1", "system-2", "system-3")


def quarter(pool, system):
    scene = load_scene(pool, (f"variant={system}", "sway.angle=0"))
    half = 0.5
    size = (half, scene.box.size[1], half)
    water = [
        w.model_copy(update={"hi": (half, w.hi[1], half), "count": round(w.count * half**2)})
        for w in scene.water
    ]
    box = scene.box.model_copy(update={"size": size})
    return scene.model_copy(update={"box": box, "water": water})


@pytest.mark.parametrize("system", SYSTEMS)
@pytest.mark.parametrize("pool", ["pool", "pool_2x"])
def test_quarter_of_a_system_stays_finite_for_ten_seconds(pool, system):
    show = Show(quarter(pool, system), 1 / 30)
    run(show, Nobody(300))
    last = show.ledger.entries[-1]
    assert last.time == pytest.approx(10.0)
    assert all(e.outside == 0 for e in show.ledger.entries)
    assert last.top_speed < 5.0
    # Conservation of mass needs no tolerance beyond that of the sum.
    assert last.mass == pytest.approx(show.ledger.entries[0].mass, rel=1e-6)
