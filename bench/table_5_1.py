"""Table 5.1 of the thesis, reproduced: SPH against M-SPH in two pools; and speed of system 3.

A frame is 1/60 s of simulated time with all its time steps. The figures of the thesis are from a
laptop of 2008 with one step per frame of unknown length, so only ratios between the systems can be
compared, not frames per second.
"""

from functools import partial

from bench.tables import Bench, Declared, Figures, Table, figures, forms, markdown
from msph.scene import load_scene
from msph.stage.benchmark import benchmark

# Gokdogan 2008, table 5.1: particles, frames/s, frames/s without rendering.
THESIS = {
    ("pool", 1): (2650, 15.0, 22.0),
    ("pool", 2): (4650, 7.0, 10.0),
    ("pool", 3): (1800, 20.0, 33.5),
    ("pool_2x", 1): (5100, 6.5, 9.0),
    ("pool_2x", 2): (9200, 3.0, 4.2),
    ("pool_2x", 3): (2500, 12.0, 24.5),
}
METHOD = {1: "SPH, 0.2 kg", 2: "SPH, 0.1 kg", 3: "M-SPH, 0.1/0.2/0.4/0.8 kg"}
# Largest rms speed of water at rest [m/s].
STILL = 0.05
# Simulated time of the systems, and of the runs of system 3 against its targets [s].
SECONDS, RUN = 10.0, 5.0
# Names of figures.
REST, BARE = "rms speed at rest, m/s", "frames/s without rendering"
# Image size [pixels] of the runs of system 3.
SIZE = (640, 360)

# Figures of a benchmark.
FIGURES: Declared = {
    "particles": (",.0f", lambda run: sum(run.particles)),
    "frames/s": (".0f", lambda run: 1e3 / run.frame_p50_ms),
    BARE: (".1f", lambda run: 1e3 / run.stages_p50_ms["fluid"]),
    "mean of the run": (".1f", lambda run: run.fluid_frames_per_second),
    "steps/s": (".0f", lambda run: run.steps_per_frame * 1e3 / run.stages_p50_ms["fluid"]),
    "surface and image, ms": (
        ".1f",
        lambda run: run.stages_p50_ms["surface"] + run.stages_p50_ms["picture"],
    ),
    "solver residual, mean": (".2%", lambda run: run.solver_residual_mean),
    "largest": (".0%", lambda run: run.solver_residual_max),
    "volume error": ("+.1%", lambda run: run.volume_error),
    "kinetic energy at rest, J": (".3f", lambda run: run.rest_energy),
    REST: (".3f", lambda run: run.rest_speed),
    "energy gain": (".2%", lambda run: run.energy_gain),
    "momentum drift": (".1%", lambda run: run.momentum_drift),
}

Systems = dict[tuple[str, int], dict[str, float]]


def system(
    pool: str, number: int, seconds: float, seed: int, changes: tuple[str, ...] = ("sway.angle=0",)
) -> Figures:
    """Returns the figures of a run of a system with the classic method, by default at rest: medians
    over its frames."""
    given = ("method=classic", f"variant=system-{number}", f"seed={seed}", *changes)
    return figures(FIGURES, benchmark(load_scene(pool, given), pool, seconds, size=SIZE))


def against_thesis(known: list[dict]) -> list[str]:
    """Returns the ratios between the systems beside the thesis's, and its claims."""
    results: Systems = {}
    for row in known:
        if row["table"] == "systems":
            pool, name = row["case"].split(" | ")
            results[pool, int(name[0])] = {k: float(row[k]) for k in FIGURES if k in row}
    if set(results) != set(THESIS):
        return []
    lines = [row_of(key, results) for key in results]
    text = ["## Ratios to system 1, in brackets the thesis's\n", markdown(lines)]
    return [*text, "\n## Claims of the thesis\n", *verdicts(results)]


def row_of(key: tuple[str, int], results: Systems) -> dict[str, str]:
    """Returns the row of a system: our figures and the thesis's, ratios to system 1."""
    pool, number = key
    ours, first = results[key], results[pool, 1]
    theirs, thesis_first = THESIS[key], THESIS[pool, 1]
    return {
        "pool": pool,
        "system": f"{number}: {METHOD[number]}",
        "particles": f"{ours['particles']:.0f} ({theirs[0]})",
        "frames/s": f"{ours['frames/s']:.0f} ({theirs[1]:g})",
        BARE: f"{ours[BARE]:.0f} ({theirs[2]:g})",
        "over system 1": f"{ours['frames/s'] / first['frames/s']:.2f} "
        f"({theirs[1] / thesis_first[1]:.2f})",
        "without rendering over system 1": f"{ours[BARE] / first[BARE]:.2f}",
        "steps/s over system 1": f"{ours['steps/s'] / first['steps/s']:.2f} "
        f"({theirs[2] / thesis_first[2]:.2f})",
    }


def verdicts(results: Systems) -> list[str]:
    """Returns the claims of the thesis, each with the figures that decide it."""
    lines = []

    def claim(text: str, holds: bool, figures: str) -> None:
        lines.append(f"- **{'Holds' if holds else 'Does not hold'}**: {text} {figures}")

    for pool in ("pool", "pool_2x"):
        for other in (1, 2):
            ours = results[pool, 3][BARE] / results[pool, other][BARE]
            step = results[pool, 3]["steps/s"] / results[pool, other]["steps/s"]
            thesis = THESIS[pool, 3][2] / THESIS[pool, other][2]
            claim(
                f"M-SPH is faster than system {other} in `{pool}`.",
                ours > 1.0,
                f"Without rendering {ours:.2f} times, by steps/s {step:.2f} times, in the thesis "
                f"{thesis:.2f} times.",
            )
    ours = results["pool_2x", 3][BARE] / results["pool", 3][BARE]
    uniform = results["pool_2x", 1][BARE] / results["pool", 1][BARE]
    claim(
        "additional depth slows M-SPH less than uniform SPH.",
        ours > uniform,
        f"At twice the depth M-SPH has {100 * ours:.0f} % of its speed, system 1 "
        f"{100 * uniform:.0f} % (thesis: {100 * 24.5 / 33.5:.0f} % and {100 * 9 / 22:.0f} %).",
    )
    speed = results["pool_2x", 2][REST]
    claim(
        "system 2 does not come to rest in `pool_2x`.",
        speed > STILL,
        f"Its rms speed in the last second is {speed:.3f} m/s; the limit is {STILL} m/s.",
    )
    calm = max(results[pool, 1][REST] for pool in ("pool", "pool_2x"))
    layered = max(results[pool, 3][REST] for pool in ("pool", "pool_2x"))
    claim(
        "M-SPH is as stable as SPH.",
        layered <= max(calm, STILL),
        f"At rest its rms speed is up to {layered:.3f} m/s, that of system 1 {calm:.3f} m/s.",
    )
    drift = max(results[pool, 3]["momentum drift"] for pool in ("pool", "pool_2x"))
    claim(
        "pair forces between layers cancel (the thesis states that they do not).",
        drift < 1e-3,
        f"Their total impulse is {100 * drift:.0f} % of the largest sum of m |v|.",
    )
    worst = min(r["volume error"] for r in results.values())
    claim(
        "the water keeps its volume.",
        worst > -0.01,
        f"The largest volume error is {100 * worst:+.1f} %, while the solver residual is small: "
        "without wall particles the water crowds at the walls.",
    )
    return lines


BENCHES = {
    "table_5_1": Bench(
        "Table 5.1 of the thesis, reproduced",
        "Frames of 1/60 s, medians; rendering includes surface and image at 640x360. The thesis "
        "(Gokdogan 2008, table 5.1): a laptop\nof 2008, one step per frame, so its ratios are "
        "comparable with our ratios of steps/s. Our finer layers need shorter\nsteps, which lowers "
        "the ratios of frames/s.\n",
        {
            "systems": Table(
                f"{SECONDS:g} s of still water each",
                ("pool", "system"),
                {
                    (pool, f"{n}: {METHOD[n]}"): partial(system, pool, n, SECONDS)
                    for pool, n in THESIS
                },
                forms(FIGURES),
                starts=1,
            ),
            # Rocking turns the view, so the backdrop is redrawn in every frame; at rest it is
            # reused.
            "system 3": Table(
                f"Speed of system 3 in the deep pool, {RUN:g} s each",
                (),
                {
                    ("steady",): partial(system, "pool_2x", 3, RUN),
                    ("rocking",): partial(system, "pool_2x", 3, RUN, changes=()),
                },
                forms(FIGURES),
                {
                    BARE: ">= 60",
                    "mean of the run": ">= 60",
                    "surface and image, ms": "<= 12",
                },
                across=True,
            ),
        },
        against_thesis,
    )
}
