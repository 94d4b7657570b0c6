"""Bodies in water against formulas: pressure on their faces, buoyancy, drafts, and energy."""

from functools import partial

from bench import floating, rows
from bench import held_bodies as held
from bench.tables import Bench, Table

# Heave decays: release [m], layers, finest spacing and width of the tank [m], shear relief (-).
HEAVES = [
    *((drop, 4, 0.0375, 1.6, 1.0) for drop in floating.KRAMER),
    *((drop, 5, 0.025, 1.6, 1.0) for drop in floating.KRAMER),
    (min(floating.KRAMER), 5, 0.025, 1.6, 0.0),
    *((drop, 7, 0.01875, 2.6, 1.0) for drop in floating.KRAMER),  # half an hour per start
]
MEDIANS = f"medians of {rows.STARTS} starts, and their range"
KINDS = ("pillar", "ball", "mesh of a pillar", "mesh of a ball")
# Bodies that float: kind, density [kg/m^3], layers, finest spacing [m].
DRAFTS = [
    (kind, density, layers, floating.FINE)
    for kind in ("cube", "ball")
    for density in floating.DENSITIES
    for layers in held.WATERS.values()
] + [("cube", 750.0, 3, 0.5 * floating.FINE)]
TABLES = {
    "faces": Table(
        f"Still water {held.DEPTH} m deep, finest spacing {held.FINE} m: pressure on faces against "
        r"$\rho g (H - y)$, vertical force over the displaced weight, and the integral of the "
        "measured pressure over the force by the ledger",
        ("body", "water"),
        {
            (kind, water): partial(held.faces, kind, water)
            for water in held.WATERS
            for kind in KINDS
        },
        {
            "pressure, mean": "+.2%",
            "worst side, mean": "+.2%",
            "rms": ".2%",
            "worst point": "+.2%",
            held.WEIGHT: ".2%",
            "pressure integral over force": "+.2%",
            "energy rise in 1 s": ".3%",
        },
        starts=1,
    ),
    "sizes": Table(
        "Submerged balls by size, uniform water: force over the displaced weight, which is the "
        f"weight of a neutrally buoyant ball (goal: 100 % within 0.03 %); {MEDIANS}",
        ("radius over spacing",),
        {(f"{r / held.FINE:.1f}",): partial(held.buoyancy, r) for r in held.RADII},
        {held.WEIGHT: ".2%"},
    ),
    "gaps": Table(
        "Bodies at floor and wall by gap, uniform water: force over the displaced weight",
        ("body", "gap over spacing"),
        {(kind, f"{gap:g}"): partial(held.at_wall, kind, gap) for kind, gap in held.GAPS},
        {"vertical": ".1%", "away from the wall": "+.1%"},
        starts=1,
    ),
    "moving": Table(
        f"Balls that move at {held.SLOW} m/s at floor and wall: {held.WAY / held.FINE:g} spacings "
        "from or to the floor, or half a spacing from the wall and along it; uniform water: force "
        "over the displaced weight, means by the time since the start of the motion; " + MEDIANS,
        ("ball", "force"),
        {(kind, force): partial(held.moving, kind) for kind, force in held.MOVES.items()},
        dict.fromkeys(held.SPANS, ".1%"),
    ),
    "collapse": Table(
        f"A column of water collapses past a ball under gravity {held.SLANTED} m/s²",
        ("radius over spacing",),
        {(f"{ratio:g}",): partial(held.collapse, ratio) for ratio in held.SIZES},
        {"energy rise in 1 s": ".3%", "solver residual, 99th percentile": ".2%", "outside": ".0f"},
        starts=1,
    ),
    "drafts": Table(
        f"Floating cube and ball {floating.HEIGHT} m high, spacings across them: draft error over "
        "the height (goal: 2 %), and largest component of the cube's axes along the vertical, 1 if "
        "it lies flat, 0.71 on an edge, 0.58 on a corner; means over the last "
        f"{floating.BOBS:g} of {floating.AFLOAT:g} s (cubes, which start flat with a spin of "
        f"{floating.KICK:g} degrees/s: {floating.TURNING:g} s); {MEDIANS}",
        ("body", "density", "layers", "spacings"),
        {
            (kind, f"{density:g}", str(layers), f"{floating.HEIGHT / fine:.0f}"): partial(
                floating.draft, kind, density, layers, fine
            )
            for kind, density, layers, fine in DRAFTS
        },
        {
            "draft error": "+.2%",
            "steepest axis": ".2f",
            "energy gain": ".0e",
            "steepest axis of least energy": ".2f",
        },
    ),
    "collisions": Table(
        "Water and a spinning cube collide without gravity: change of the momenta of water and "
        f"cube (goal: 1e-5) over their scales; {MEDIANS}",
        ("density over water's",),
        {
            (f"{density / 1000.0:g}",): partial(floating.collision, density)
            for density in (50.0, 500.0, 20_000.0)
        },
        {"momentum": ".0e", "angular momentum": ".0e", "energy gain": ".0e"},
    ),
    "hard": Table(
        f"Hard cases; {MEDIANS}",
        ("case",),
        {(name,): partial(floating.hard, name) for name in floating.HARD},
        {
            "energy gain": ".0e",
            "fastest body at the end [m/s]": ".2f",
            "leaked particles": ".0f",
        },
    ),
    "heave": Table(
        f"Heave decay of a half-submerged ball in water {floating.DEEP} m deep: twice the time "
        "between the first two passages of the equilibrium, and first trough, against Kramer et "
        f"al. 2021 and against potential flow (bench/heave_theory.py); goals: 3 %; {MEDIANS}",
        ("release [mm]", "layers", "spacings per radius", "tank [m]", "shear relief"),
        {
            (
                f"{1e3 * drop:.1f}",
                str(n),
                f"{floating.RADIUS / fine:.1f}",
                f"{width:g}",
                f"{relief:g}",
            ): partial(floating.heave, drop, n, fine, width, relief)
            for drop, n, fine, width, relief in HEAVES
        },
        {
            "period error": "+.1%",
            "trough error": "+.1%",
            "period, potential flow": "+.1%",
            "trough, potential flow": "+.1%",
        },
    ),
}
BENCHES = {"bodies": Bench("Bodies in water", "", TABLES)}
