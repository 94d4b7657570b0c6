"""Speed and errors of every shipped scene, by `msph measure`.

python bench/scenes.py [--seconds 2] [--arch cpu]
"""

import json
import subprocess
import sys
import tempfile
from pathlib import Path

import click
from tabulate import tabulate

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from bench import gains
from bench.gains import uniform
from bench.report import RESULTS, heading
from msph.device import ARCHES, start
from msph.scene.library import shipped_scenes


def summary(scene: str, seconds: float, arch: str) -> dict:
    """Returns the summary of `msph measure` for a scene; raises CalledProcessError if it fails."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "msph", "measure", scene, "-o", folder, "--arch", arch]
        command += ["--seconds", str(seconds)]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        return json.loads((Path(folder) / "summary.json").read_text())


def gain(scene: str, seconds: float, arch: str) -> str:
    """Returns the speed-up of layers over uniform water, and the speed-up over the ratio of the
    numbers of particles."""
    if not uniform(scene):
        return "-"
    command = [sys.executable, gains.__file__, scene, "--seconds", str(seconds), "--arch", arch]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    found = json.loads(done.stdout.splitlines()[-1])
    faster = found["speed_up"]
    return f"{faster:.2f}, {faster / found['particle_ratio']:.2f}"


def measure(scene: str, seconds: float, arch: str) -> dict[str, str]:
    """Returns the table row of a scene; raises CalledProcessError if a run fails."""
    found = summary(scene, seconds, arch)
    errors = found["errors"]
    return {
        "scene": scene,
        "particles at the end": f"{sum(found['particles_end']):,}",
        "ms per frame": f"{found['frame_ms_p50']:.1f} "
        f"({found['frame_ms_p25']:.1f} to {found['frame_ms_p75']:.1f})",
        "real-time factor": f"{found['simulated_per_wall']:.2f}",
        "speed-up over uniform; over ratio of particles": gain(scene, seconds, arch),
        "bulk density error, mean": percent(errors["bulk_density_error_mean"]),
        "worst": percent(errors["bulk_density_error_worst"]),
        "at the end": percent(errors["bulk_density_error_last"]),
        "volume error, mean": percent(errors["volume_error_mean"]),
        "energy rise in 1 s": percent(errors["energy_rise_in_1_s"]),
        "kernel density error, mean": percent(errors["kernel_density_error_mean"]),
        "99th percentile of it": percent(errors["kernel_density_error_p99"]),
        "solver residual, mean": percent(errors["solver_residual_mean"]),
        "99th percentile": percent(errors["solver_residual_p99"]),
        "largest": percent(errors["solver_residual_max"]),
        "mass change": f"{errors['mass_change']:.0e}",
        "outside": f"{errors['outside_most']}",
    }


def percent(share: float | None) -> str:
    return "-" if share is None else f"{100.0 * share:+.2f} %"


@click.command()
@click.option("--seconds", default=2.0, show_default=True, help="Simulated time of each scene [s].")
@click.option("--arch", type=click.Choice(ARCHES), default="auto", show_default=True)
def main(seconds: float, arch: str) -> None:
    """Measure all scenes and write bench/results/scenes.md."""
    arch = start(arch)
    rows = []
    for scene in shipped_scenes():
        rows.append(measure(scene, seconds, arch))
        click.echo(" ".join(rows[-1].values()))
    report = [
        heading("The shipped scenes", arch),
        f"{seconds:g} s of each shipped scene. Energy rise: without input, over M g H. A dash:\n"
        "the water is too shallow to measure it. Uniform water: all particles have the size of "
        "the\nfinest layer; both run in alternating frames; ratio of particles: mean over "
        "frames.\n",
        tabulate(rows, headers="keys", tablefmt="github", disable_numparse=True),
        "",
    ]
    (RESULTS / "scenes.md").write_text("\n".join(report))
    click.echo("\n".join(report))


if __name__ == "__main__":
    main()
