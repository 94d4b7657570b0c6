"""Compares time and errors of the simulation with another checkout of the project.

The two checkouts run in turn. The errors are means of `msph bench`.

python bench/against.py ../before [--scene drop] [--rounds 5] [--seconds 1]
"""

import json
import os
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

import click
from tabulate import tabulate

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from bench.rows import spread

ROOT = Path(__file__).resolve().parent.parent

SCENES = (
    *("drop", "dam_break", "pillar", "pool", "still", "deep", "pool_2x"),
    *("duck", "bowl", "paddle", "lock", "waves", "honey"),
)

ERRORS = (
    *("bulk_density_error", "kernel_density_error", "solver_residual_mean"),
    *("momentum_drift", "energy_gain"),
)


def run(root: Path, scene: str, seconds: float) -> dict:
    """Returns the row of `msph bench SCENE --no-render` of the checkout at `root`."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "rows.json"
        command = [sys.executable, "main.py", "bench", scene, "--no-render"]
        command += ["--seconds", str(seconds), "--json", str(path)]
        environment = {**os.environ, "PYTHONPATH": str(root)}
        subprocess.run(command, cwd=root, env=environment, check=True, capture_output=True)
        return json.loads(path.read_text())[0]


@click.command()
@click.argument("before", type=click.Path(exists=True, file_okay=False, path_type=Path))
@click.option("--scene", "scenes", multiple=True, default=SCENES, help="Repeatable.")
@click.option("--rounds", default=5, show_default=True, type=click.IntRange(1))
@click.option("--seconds", default=1.0, show_default=True, help="Simulated time of a run [s].")
def main(before: Path, scenes: tuple[str, ...], rounds: int, seconds: float) -> None:
    """Run SCENES of this checkout and of the one at BEFORE in turn; print a table."""
    table = []
    for scene in scenes:
        found: dict[Path, list[dict]] = {before.resolve(): [], ROOT: []}
        for _ in range(rounds):
            for root, rows in found.items():
                rows.append(run(root, scene, seconds))
        old, new = (
            [1e3 / row["fluid_frames_per_second"] for row in rows] for rows in found.values()
        )
        errors = [
            " / ".join(
                "unknown"
                if any(row[name] is None for row in rows)
                else f"{statistics.median(row[name] for row in rows):.2g}"
                for name in ERRORS
                if name in rows[0]
            )
            for rows in found.values()
        ]
        ratio = [b / a for a, b in zip(old, new, strict=True)]
        table.append([scene, spread(old, ".1f"), spread(new, ".1f"), spread(ratio, ".2f"), *errors])
        click.echo(f"{scene}: {table[-1][3]}", err=True)
    heads = ["scene", "before, ms per frame", "now", "ratio in a round"]
    heads += ["errors before", "errors now"]
    click.echo(f"Errors: {', '.join(ERRORS)}, as far as a checkout has them.\n")
    click.echo(tabulate(table, headers=heads, tablefmt="github", disable_numparse=True))


if __name__ == "__main__":
    main()
