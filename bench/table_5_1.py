"""Table 5.1 of the thesis, reproduced: SPH against M-SPH in two pools.

    python bench/table_5_1.py [--seconds 10] [--arch cpu]

A frame is 1/60 s of simulated time with all its time steps. The figures of the thesis are from a
laptop of 2008 with one step per frame of unknown length, so only ratios between the systems can be
compared, not frames per second.
"""

import csv
import sys
from pathlib import Path

import click
import matplotlib
from tabulate import tabulate

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from bench.report import RESULTS, heading
from msph.device import ARCHES, start
from msph.scene import load_scene
from msph.stage.benchmark import Result, benchmark

matplotlib.use("Agg")
import matplotlib.pyplot as plt

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


def simulation_fps(result: Result) -> float:
    """Returns the median frames per second of the simulation without rendering."""
    return 1e3 / (result.stages_p50_ms["fluid"])


def steps_per_second(result: Result) -> float:
    """Returns the time steps per second without rendering, which the thesis calls frames."""
    return result.steps_per_frame * simulation_fps(result)


def rendered_fps(result: Result) -> float:
    """Returns the median frames per second with rendering."""
    return 1e3 / result.frame_p50_ms


def row(key: tuple[str, int], results: dict[tuple[str, int], Result]) -> dict[str, str]:
    """Returns a row of the table: our figures and the thesis's, ratios to system 1, errors."""
    pool, system = key
    result, (count, fps, bare) = results[key], THESIS[key]
    first, thesis_first = results[pool, 1], THESIS[pool, 1]
    momentum = result.momentum_drift
    steps = steps_per_second(result) / steps_per_second(first)
    return {
        "pool": pool,
        "system": f"{system}: {METHOD[system]}",
        "particles (thesis)": f"{sum(result.particles)} ({count})",
        "frames/s (thesis)": f"{rendered_fps(result):.0f} ({fps:g})",
        "frames/s without rendering (thesis)": f"{simulation_fps(result):.0f} ({bare:g})",
        "over system 1 (thesis)": f"{rendered_fps(result) / rendered_fps(first):.2f} "
        f"({fps / thesis_first[1]:.2f})",
        "without rendering over system 1": f"{simulation_fps(result) / simulation_fps(first):.2f}",
        "steps/s over system 1 (thesis)": f"{steps:.2f} ({bare / thesis_first[2]:.2f})",
        "solver residual mean / max %": f"{100 * result.solver_residual_mean:.2f} / "
        f"{100 * result.solver_residual_max:.0f}",
        "volume error %": f"{100 * result.volume_error:+.1f}",
        "kinetic energy at rest J": f"{result.rest_energy:.3f}",
        "rms speed at rest m/s": f"{result.rest_speed:.3f}"
        + (" oscillates" if result.rest_speed > STILL else ""),
        "energy gain %": f"{100 * result.energy_gain:.2f}",
        "momentum drift %": f"{100 * momentum:.1f}" if momentum > 5e-4 else f"{100 * momentum:.0e}",
    }


def verdicts(results: dict[tuple[str, int], Result]) -> list[str]:
    """Returns the claims of the thesis, each with the figures that decide it."""
    lines = []

    def claim(text: str, holds: bool, figures: str) -> None:
        lines.append(f"- **{'Holds' if holds else 'Does not hold'}**: {text} {figures}")

    for pool in ("pool", "pool_2x"):
        for other in (1, 2):
            ours = simulation_fps(results[pool, 3]) / simulation_fps(results[pool, other])
            step = steps_per_second(results[pool, 3]) / steps_per_second(results[pool, other])
            thesis = THESIS[pool, 3][2] / THESIS[pool, other][2]
            claim(
                f"M-SPH is faster than system {other} in `{pool}`.",
                ours > 1.0,
                f"Without rendering {ours:.2f} times, by steps/s {step:.2f} times, in the thesis "
                f"{thesis:.2f} times.",
            )
    ours = simulation_fps(results["pool_2x", 3]) / simulation_fps(results["pool", 3])
    uniform = simulation_fps(results["pool_2x", 1]) / simulation_fps(results["pool", 1])
    claim(
        "additional depth slows M-SPH less than uniform SPH.",
        ours > uniform,
        f"At twice the depth M-SPH has {100 * ours:.0f} % of its speed, system 1 "
        f"{100 * uniform:.0f} % (thesis: {100 * 24.5 / 33.5:.0f} % and {100 * 9 / 22:.0f} %).",
    )
    speed = results["pool_2x", 2].rest_speed
    claim(
        "system 2 does not come to rest in `pool_2x`.",
        speed > STILL,
        f"Its rms speed in the last second is {speed:.3f} m/s; the limit is {STILL} m/s.",
    )
    calm = max(results[pool, 1].rest_speed for pool in ("pool", "pool_2x"))
    layered = max(results[pool, 3].rest_speed for pool in ("pool", "pool_2x"))
    claim(
        "M-SPH is as stable as SPH.",
        layered <= max(calm, STILL),
        f"At rest its rms speed is up to {layered:.3f} m/s, that of system 1 {calm:.3f} m/s.",
    )
    drift = max(results[pool, 3].momentum_drift for pool in ("pool", "pool_2x"))
    claim(
        "pair forces between layers cancel (the thesis states that they do not).",
        drift < 1e-3,
        f"Their total impulse is {100 * drift:.0f} % of the largest sum of m |v|.",
    )
    worst = min(r.volume_error for r in results.values())
    claim(
        "the water keeps its volume.",
        worst > -0.01,
        f"The largest volume error is {100 * worst:+.1f} %, while the solver residual is small: "
        "without wall particles the water crowds at the walls.",
    )
    return lines


def plot(results: dict[tuple[str, int], Result], path: Path) -> None:
    """Plots speeds over system 1, ours and the thesis's, and errors."""
    keys = list(results)
    names = [f"{pool}\nsystem {system}" for pool, system in keys]
    figure, (speed, error) = plt.subplots(1, 2, figsize=(12, 4.5))
    base = {pool: steps_per_second(results[pool, 1]) for pool, _ in keys}
    ours = [steps_per_second(results[k]) / base[k[0]] for k in keys]
    theirs = [THESIS[k][2] / THESIS[k[0], 1][2] for k in keys]
    x = range(len(keys))
    speed.bar([i - 0.2 for i in x], ours, 0.4, label="here")
    speed.bar([i + 0.2 for i in x], theirs, 0.4, label="thesis, 2008")
    speed.set_title("steps per second without rendering, over system 1")
    error.bar(
        [i - 0.2 for i in x],
        [-100 * results[k].volume_error for k in keys],
        0.4,
        label="volume lost, %",
    )
    error.bar(
        [i + 0.2 for i in x],
        [100 * results[k].solver_residual_mean for k in keys],
        0.4,
        label="mean solver residual, %",
    )
    error.set_title("errors")
    for axis in (speed, error):
        axis.set_xticks(list(x), names, fontsize=8)
        axis.legend(loc="upper left", bbox_to_anchor=(0.0, 1.0), framealpha=1.0)
        axis.margins(y=0.25)
        axis.spines[["top", "right"]].set_visible(False)
    figure.tight_layout()
    figure.savefig(path, dpi=110)


@click.command()
@click.option(
    "--seconds", default=10.0, show_default=True, help="Simulated time of each system [s]."
)
@click.option("--arch", type=click.Choice(ARCHES), default="auto", show_default=True)
def main(seconds: float, arch: str) -> None:
    """Run the systems of table 5.1 and write bench/results/table_5_1.{md,csv,png}."""
    arch = start(arch)
    results = {}
    for pool, system in THESIS:
        click.echo(f"{pool}, system {system} ...", err=True)
        scene = load_scene(pool, (f"variant=system-{system}", "method=classic", "sway.angle=0"))
        results[pool, system] = benchmark(scene, pool, seconds)
    rows = [row(key, results) for key in results]
    table = tabulate(rows, headers="keys", tablefmt="github", disable_numparse=True)
    text = [
        heading("Table 5.1 of the thesis, reproduced", arch),
        f"{seconds:g} s of still water each, frames of 1/60 s, medians; rendering includes surface "
        "and image at 640x360.\nIn brackets the thesis (Gokdogan 2008, table 5.1): a laptop of "
        "2008, one step per frame, so its ratios\nare comparable with our ratios of steps/s. Our "
        "finer layers need shorter steps, which lowers the ratios of frames/s.\n",
        table,
        "\n## Claims of the thesis\n",
        *verdicts(results),
        "\n![speed and error](table_5_1.png)\n",
    ]
    RESULTS.mkdir(exist_ok=True)
    (RESULTS / "table_5_1.md").write_text("\n".join(text))
    with open(RESULTS / "table_5_1.csv", "w", newline="") as file:
        writer = csv.DictWriter(file, rows[0])
        writer.writeheader()
        writer.writerows(rows)
    plot(results, RESULTS / "table_5_1.png")
    click.echo("\n".join(text))


if __name__ == "__main__":
    main()
