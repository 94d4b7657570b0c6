"""Every shipped scene as `msph measure` sees it: speed beside every error figure.

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
    """What `msph measure` says of a scene; raises CalledProcessError where its run fails."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "msph", "measure", scene, "-o", folder, "--arch", arch]
        command += ["--seconds", str(seconds)]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        return json.loads((Path(folder) / "summary.json").read_text())


def gain(scene: str, seconds: float, arch: str) -> str:
    """Speed-up of layers over uniform water, and that over the ratio of particle counts."""
    if not uniform(scene):
        return "-"
    command = [sys.executable, gains.__file__, scene, "--seconds", str(seconds), "--arch", arch]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    found = json.loads(done.stdout.splitlines()[-1])
    faster = found["times as fast"]
    return f"{faster:.2f}, {faster / found['times as many']:.2f}"


def measure(scene: str, seconds: float, arch: str) -> dict[str, str]:
    """The row of one scene; raises CalledProcessError where a run fails."""
    found = summary(scene, seconds, arch)
    errors = found["errors"]
    return {
        "scene": scene,
        "particles at the end": f"{sum(found['particles_end']):,}",
        "ms a frame": f"{found['frame_ms_p50']:.1f} "
        f"({found['frame_ms_p25']:.1f} to {found['frame_ms_p75']:.1f})",
        "simulated s/s": f"{found['simulated_per_wall']:.2f}",
        "times as fast as uniform, over ratio of counts": gain(scene, seconds, arch),
        "bulk density, mean": percent(errors["bulk_density_error_mean"]),
        "worst": percent(errors["bulk_density_error_worst"]),
        "at the end": percent(errors["bulk_density_error_last"]),
        "surface's volume, mean": percent(errors["volume_error_mean"]),
        "energy rise in 1 s": percent(errors["energy_rise_in_1_s"]),
        "density error mean": percent(errors["density_error_mean"]),
        "99th percentile": percent(errors["density_error_p99"]),
        "largest": percent(errors["density_error_max"]),
        "mass change": f"{errors['mass_change']:.0e}",
        "outside": f"{errors['outside_most']}",
    }


def percent(share: float | None) -> str:
    return "-" if share is None else f"{100.0 * share:+.2f} %"


@click.command()
@click.option("--seconds", default=2.0, show_default=True, help="Simulated time of each scene.")
@click.option("--arch", type=click.Choice(ARCHES), default="auto", show_default=True)
def main(seconds: float, arch: str) -> None:
    """Measure all and write bench/results/scenes.md."""
    arch = start(arch)
    rows = []
    for scene in shipped_scenes():
        rows.append(measure(scene, seconds, arch))
        click.echo(" ".join(rows[-1].values()))
    report = [
        heading("The shipped scenes", arch),
        f"{seconds:g} s of each, as shipped. Energy rises while nobody gives any, over M g H.\n"
        "No figure where the water is not deep enough for one. Uniform water: all as fine as the\n"
        "finest layer, in turn with the layers frame by frame; ratio of counts: their mean.\n",
        tabulate(rows, headers="keys", tablefmt="github", disable_numparse=True),
        "",
    ]
    (RESULTS / "scenes.md").write_text("\n".join(report))
    click.echo("\n".join(report))


if __name__ == "__main__":
    main()
