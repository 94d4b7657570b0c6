"""Solver residual and kinetic energy of every shipped scene on another device and on the CPU.

python bench/vulkan.py [--arch vulkan] [--seconds 0.2] [--quality small]
"""

import json
import sys
from pathlib import Path

import click
from tabulate import tabulate

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from bench.report import RESULTS, heading
from bench.rows import in_process
from msph.device import start
from msph.errors import BlowUpError
from msph.options import AS_GIVEN
from msph.scene import load_scene
from msph.scene.library import shipped_scenes
from msph.scene.quality import at_quality, single_quality_reason
from msph.stage.controls import Controls
from msph.stage.show import Show

SEEDS, FRAME = (0, 1, 2), 1.0 / 60.0
# Time limit of all runs on a device [s], and number of characters of a failure that are shown.
MAX_SECONDS, MAX_CHARACTERS = 1800.0, 100
# Quantities of facts(): key, name, unit, factor of the unit.
QUANTITIES = (
    ("density", "solver residual", "%", 100.0),
    ("kinetic", "kinetic energy", "J", 1.0),
)


def facts(name: str, seed: int, frames: int, quality: str) -> dict[str, float]:
    """Runs a scene for `frames`; returns its number of particles, mean solver residual (-) and
    kinetic energy [J]."""
    scene = load_scene(name, (f"seed={seed}",))
    show = Show(
        at_quality(scene, AS_GIVEN if single_quality_reason(scene) else quality, name), FRAME
    )
    for _ in range(frames):
        show.frame(Controls())
    last = show.ledger.entries[-1]
    found = {
        "particles": show.simulation.particles.count,
        "kinetic": last.kinetic,
        "density": last.solver_residual_mean,
    }
    show.close()
    return found


def work(task: dict) -> dict[str, list[dict] | str]:
    """Returns facts() of each scene and seed on the device of the task, or a failure message."""
    start(task["arch"], tested=True)
    found: dict[str, list[dict] | str] = {}
    for name in shipped_scenes():
        try:
            found[name] = [facts(name, k, task["frames"], task["quality"]) for k in task["seeds"]]
        # Taichi raises RuntimeError for code that a driver rejects.
        except (BlowUpError, RuntimeError) as error:
            found[name] = f"failed: {error}"[:MAX_CHARACTERS]
    return found


def row(scene: str, arch: str, cpu: list[dict] | str, other: list[dict] | str) -> dict[str, str]:
    """Returns the row of a scene: values of the first seed, and the range over seeds on the CPU."""
    if isinstance(cpu, str) or isinstance(other, str):
        return {"scene": scene, "particles": next(f for f in (other, cpu) if isinstance(f, str))}
    found = {"scene": scene, "particles": f"{other[0]['particles']:,}"}
    for key, quantity, unit, scale in QUANTITIES:
        values = [scale * each[key] for each in cpu]
        found[f"{quantity}, {arch} [{unit}]"] = f"{scale * other[0][key]:.4g}"
        found[f"CPU [{unit}]"] = f"{values[0]:.4g}"
        found[f"CPU by seeds [{unit}]"] = f"{min(values):.4g} to {max(values):.4g}"
    return found


@click.command()
@click.option("--arch", default="vulkan", show_default=True, help="Device to compare.")
@click.option("--seconds", default=0.2, show_default=True, help="Simulated time of each scene [s].")
@click.option("--quality", default="small", show_default=True, help="As for `msph bench`.")
@click.option("--worker", hidden=True, help="Task of one process, as JSON.")
def main(arch: str, seconds: float, quality: str, worker: str | None) -> None:
    """Run every scene and write bench/results/vulkan.md (or ARCH.md for another device)."""
    if worker:
        print(json.dumps(work(json.loads(worker))))
        return
    task = {"frames": round(seconds / FRAME), "quality": quality}
    cpu = in_process(__file__, {**task, "arch": "cpu", "seeds": SEEDS}, MAX_SECONDS)
    other = in_process(__file__, {**task, "arch": arch, "seeds": SEEDS[:1]}, MAX_SECONDS)
    for found in (cpu, other):
        if "failure" in found:
            raise click.ClickException(found["failure"])
    rows = [row(name, arch, cpu[name], other[name]) for name in shipped_scenes()]
    report = [
        heading(f"The shipped scenes on {arch} and on the CPU", arch),
        f"{seconds:g} s of each at quality {quality} (large for scenes with a single quality),\n"
        "from the same particles. CPU by seeds: range over "
        f"{len(SEEDS)} random initial positions.\n",
        tabulate(rows, headers="keys", tablefmt="github", disable_numparse=True),
        "",
    ]
    (RESULTS / f"{arch}.md").write_text("\n".join(report))
    click.echo("\n".join(report))


if __name__ == "__main__":
    main()
