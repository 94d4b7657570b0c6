"""Cases of the sweep of speed against error (bench/pareto.py), by name."""

from bench.cases import (
    balls,
    block,
    dam_break,
    hydrostatic,
    settling,
    sloshing,
    thesis_pool,
    vortex,
)
from bench.cases.case import Case

CASES: dict[str, Case] = {
    case.name: case
    for case in (
        hydrostatic.CASE,
        sloshing.SLOSHING,
        sloshing.DEEP_SLOSHING,
        sloshing.STANDING_WAVE,
        vortex.TAYLOR_GREEN,
        vortex.SHEAR_WAVE,
        vortex.INVISCID_VORTEX,
        dam_break.CASE,
        balls.COLLISION,
        balls.FALLING_DROP,
        settling.CASE,
        thesis_pool.CASE,
        block.CASE,
    )
}
