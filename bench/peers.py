"""Comparison with other programs: fluid with SPlisHSPlasH (DFSPH), surface with three others.

python bench/peers.py [--repeats 3] [--most 99452] [--arch cpu]

The other programs are optional: pip install '.[peers]'; missing ones are skipped with a message.
Every run of a fluid is a separate process; the programs alternate. The wheel of pySPlisHSPlasH may
need the system's libGLdispatch: see bench/peer_splishsplash.py, which also sets its OpenMP threads
to wait passively.
"""

import json
import math
import subprocess
import sys
import tempfile
from dataclasses import asdict
from pathlib import Path

import click
import numpy as np
from tabulate import tabulate

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from bench import peer_splishsplash, peer_surfaces, peer_tank
from bench.peer_tank import Run, Tank
from bench.report import RESULTS, heading, load
from msph.device import ARCHES

# Blocks of about 1 m^3.
TANKS = (
    Tank((14, 14, 13), 14),
    Tank((17, 17, 17), 17),
    Tank((27, 27, 27), 27),
    Tank((46, 46, 47), 46),
)
# Largest number of particles for full runs; larger blocks run for --starting seconds.
FULL_RUNS = 50_000
# Block whose surface is computed.
SURFACE_OF = TANKS[2]
# Target for surfaces: speed-up over the fastest other program.
SURFACE_TARGET = 5.0
THEIRS, UNIFORM, LAYERED = "SPlisHSPlasH, DFSPH", "ours, uniform", "ours, layered"
# Ours with longer steps and a looser tolerance, at about the compression of DFSPH.
UNIFORM_LOOSER, LAYERED_LOOSER = "ours, uniform, looser", "ours, layered, looser"
OURS = (UNIFORM, LAYERED, UNIFORM_LOOSER, LAYERED_LOOSER)
FLUIDS = (THEIRS, *OURS)


def work(task: dict) -> object:
    """Work of a separate process: returns a run of a fluid as a dictionary, or times of
    surfaces."""
    tank = Tank(tuple(task["counts"]), task["per_metre"])
    if task["kind"] == "surfaces":
        return peer_surfaces.measured(tank, task["rounds"], task["arch"])
    if task["kind"] == THEIRS:
        water = peer_splishsplash.Dfsph(tank.scene(1))
        return asdict(peer_tank.run(tank, water, task["seconds"], water.settings()))
    water, words = peer_tank.ours(tank, *(task[k] for k in ("layers", "looser", "arch")))
    return asdict(peer_tank.run(tank, water, task["seconds"], words))


def in_process(kind: str, tank: Tank, folder: str, **task) -> object | None:
    """Runs work() in a separate process; prints a message and returns None if it fails."""
    out = Path(folder) / "found.json"
    task |= {"kind": kind, "out": str(out), **asdict(tank)}
    command = [sys.executable, __file__, "--worker", json.dumps(task)]
    done = subprocess.run(command, capture_output=True, text=True, errors="replace")
    # The result is a file, because other programs print and may crash when they exit.
    if not out.exists():
        why = done.stderr.strip().splitlines()[-1:] or [f"exit status {done.returncode}"]
        click.echo(f"{kind}, {tank.particles:,} particles: skipped, {why[0]}")
        return None
    found = json.loads(out.read_text())
    out.unlink()
    return found


def spread(values: list[float]) -> str:
    """Returns the median (minimum to maximum) of the values."""
    read = (float(np.median(values)), min(values), max(values))
    shown = [f"{v:.0f}" if v >= 10.0 else f"{v:.2g}" for v in read]
    return f"{shown[0]} ({shown[1]} to {shown[2]})" if len(values) > 1 else shown[0]


def percent(values: list[float], digits: int) -> str:
    """Returns the mean of the known values (-) in percent."""
    known = [v for v in values if not math.isnan(v)]
    return f"{100.0 * np.mean(known):.{digits}f} %" if known else "-"


def speeds(tank: Tank, seconds: float, runs: dict[str, list[Run]]) -> dict[str, str]:
    """Returns the row of a block: real-time factors."""
    row = {"particles": f"{tank.particles:,}", "simulated s": f"{seconds:g}"}
    for kind in FLUIDS:
        row[kind] = spread([run.speed for run in runs[kind]]) if runs[kind] else "-"
    theirs = [run.speed for run in runs[THEIRS]]
    for kind in OURS:
        ours = [run.speed for run in runs[kind]]
        known = theirs and ours
        row[f"{kind} / {THEIRS}"] = f"{np.median(ours) / np.median(theirs):.2f}" if known else "-"
    return row


def details(tank: Tank, runs: dict[str, list[Run]]) -> list[dict[str, str]]:
    """Returns the rows of a block, one for each fluid: errors, time steps and iterations."""
    rows = []
    for kind in FLUIDS:
        if runs[kind]:
            last = runs[kind][-1]
            residual = [r for run in runs[kind] for r in run.residual]
            rows.append(
                {
                    "block": f"{tank.particles:,}",
                    "fluid": kind,
                    "particles, start to end": f"{last.particles_start:,} to "
                    f"{last.particles_end:,}",
                    "solver residual, mean": percent(residual, 3),
                    "worst frame": percent([max(residual)], 3),
                    "kernel density error, mean": percent(
                        [k for run in runs[kind] for k in run.kernel], 2
                    ),
                    "bulk density error": percent(
                        [b - 1.0 for run in runs[kind] for b in run.bulk], 1
                    ),
                    "mean dt, ms": f"{1e3 * last.simulated / max(last.steps, 1):.2f}",
                    "iterations per step": f"{last.iterations / max(last.steps, 1):.1f}",
                    "us per particle and step": f"{_per_step(last):.2f}",
                }
            )
    return rows


def _per_step(run: Run) -> float:
    """Returns the elapsed time per particle and step [us]."""
    return 1e6 * run.wall / max(run.steps, 1) / (0.5 * (run.particles_start + run.particles_end))


def surface_rows(found: dict) -> list[dict[str, str]]:
    """Returns the rows of the table of surfaces."""
    rows = []
    for name, ways in found.items():
        peers = {way: np.median(t) for way, (_, t) in ways.items() if not way.startswith("ours")}
        for way, (count, times) in ways.items():
            fastest = min(peers.values(), default=math.nan) / np.median(times)
            rows.append(
                {
                    "surface": name,
                    "program": way,
                    "triangles": f"{count:,}",
                    "ms": spread(times),
                    "speed-up over the fastest other": "-" if way in peers else f"{fastest:.1f}",
                }
            )
    return rows


def table(rows: list[dict[str, str]]) -> str:
    return tabulate(rows, headers="keys", tablefmt="github", disable_numparse=True)


class Report:
    """The report bench/results/peers.md, rewritten after every row."""

    def __init__(self, arch: str, repeats: int, skipped: list[str]):
        self.title = heading("Comparison with other programs", arch) + load()
        self.repeats, self.skipped = repeats, skipped
        self.speeds: list[dict[str, str]] = []
        self.details: list[dict[str, str]] = []
        self.surfaces: list[dict[str, str]] = []
        self.settings: dict[str, str] = {}

    def write(self) -> str:
        """Writes and returns the report."""
        parts = [self.title, *(f"{line}.\n" for line in self.skipped)]
        if self.speeds:
            parts += [
                f"A block of about 1 m^3 collapses in a tank {peer_tank.LENGTH:g} m long and "
                f"{peer_tank.HEIGHT:g} m high. Real-time factors: median of "
                f"{self.repeats} alternating runs (minimum to maximum), without start, compilation "
                "and measurements.\n",
                table(self.speeds),
                "\nSolver residual: mean over particles of max(rho/rho0 - 1, 0), rho each method's "
                "own density. Kernel and bulk density error: from positions, by the same code for "
                "both (msph/measure), the latter away from surface and walls. DFSPH is that of "
                "SPlisHSPlasH, with its walls moved outwards by the gap that it keeps "
                "(bench/peer_splishsplash.py). Iterations: of the density solve of DFSPH, without "
                "its divergence solve; of our pressure solve.\n",
                table(self.details),
                "\nSettings:\n",
                *(f"- {kind}: {text}" for kind, text in self.settings.items()),
                "",
            ]
        if self.surfaces:
            parts += [
                f"Surfaces; target: {SURFACE_TARGET:g} times as fast as the fastest other program. "
                "Ours from particles sorted by the simulation; splashsurf without smoothing, "
                f"smoothing length {peer_surfaces.SMOOTHING_LENGTH:g} radii. "
                f"{peer_surfaces.versions()}.\n",
                table(self.surfaces),
                "",
            ]
        text = "\n".join(parts)
        RESULTS.mkdir(exist_ok=True)
        (RESULTS / "peers.md").write_text(text)
        return text


def skipped_peers() -> list[str]:
    """Returns a message for each missing program."""
    names = [peer_splishsplash.MODULE] if peer_splishsplash.missing() else []
    names += peer_surfaces.missing()
    return [f"{name} is not installed: skipped (pip install '.[peers]')" for name in names]


@click.command()
@click.option(
    "--repeats",
    default=3,
    show_default=True,
    type=click.IntRange(min=1),
    help="Number of runs of each fluid.",
)
@click.option("--seconds", default=2.0, show_default=True, help="Simulated time of a full run [s].")
@click.option(
    "--starting",
    default=0.25,
    show_default=True,
    help="Simulated time of blocks too large for full runs [s].",
)
@click.option(
    "--most",
    default=TANKS[-1].particles,
    show_default=True,
    help="Number of particles of the largest block.",
)
@click.option("--layers", default=3, show_default=True, help="Layers of our layered fluid.")
@click.option("--rounds", default=20, show_default=True, help="Rounds of each surface.")
@click.option("--arch", type=click.Choice(ARCHES), default="cpu", show_default=True)
@click.option("--worker", hidden=True, help="Task of a separate process as JSON.")
def main(
    repeats: int,
    seconds: float,
    starting: float,
    most: int,
    layers: int,
    rounds: int,
    arch: str,
    worker: str | None,
) -> None:
    """Run all programs and write bench/results/peers.md."""
    if worker is not None:
        task = json.loads(worker)
        found = json.dumps(work(task))
        Path(task["out"]).write_text(found)
        return
    report = Report(arch, repeats, skipped_peers())
    for line in report.skipped:
        click.echo(line)
    kinds = [kind for kind in FLUIDS if kind != THEIRS or not peer_splishsplash.missing()]
    with tempfile.TemporaryDirectory() as folder:
        for tank in (t for t in TANKS if t.particles <= most):
            time = seconds if tank.particles <= FULL_RUNS else min(starting, seconds)
            runs: dict[str, list[Run]] = {kind: [] for kind in FLUIDS}
            for _ in range(repeats):
                for kind in kinds:
                    count = layers if kind in (LAYERED, LAYERED_LOOSER) else 1
                    looser = kind in (UNIFORM_LOOSER, LAYERED_LOOSER)
                    task = {"seconds": time, "layers": count, "looser": looser, "arch": arch}
                    found = in_process(kind, tank, folder, **task)
                    if found:
                        runs[kind].append(Run(**found))
                        report.settings[kind] = runs[kind][-1].settings
            report.speeds.append(speeds(tank, time, runs))
            report.details += details(tank, runs)
            report.write()
        found = in_process("surfaces", SURFACE_OF, folder, rounds=rounds, arch=arch)
        report.surfaces = surface_rows(found) if found else []
    click.echo(report.write())


if __name__ == "__main__":
    main()
