"""Our water beside pySPlisHSPlasH's DFSPH, our surface beside others': speed beside error.

python bench/peers.py [--repeats 3] [--most 99452] [--arch cpu]

Peers are optional: pip install '.[peers]'; each that is missing is skipped with a line. Every run
of water is a process of its own, and all take turns. The wheel of pySPlisHSPlasH may need the
system's libGLdispatch: see bench/peer_splishsplash.py. OpenMP's threads wait by spinning: where
others use the machine, that costs it most of its speed unless OMP_WAIT_POLICY=passive is set.
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

# Blocks of about a cubic metre.
TANKS = (
    Tank((14, 14, 13), 14),
    Tank((17, 17, 17), 17),
    Tank((27, 27, 27), 27),
    Tank((46, 46, 47), 46),
)
# Blocks of more particles only start: a whole run takes minutes.
WHOLE_RUNS = 50_000
# The block whose surface is taken.
SURFACE_OF = TANKS[2]
# Targets for surfaces: times as fast as the fastest peer.
SURFACE_TARGET = 5.0
THEIRS, UNIFORM, LAYERED = "DFSPH", "ours, uniform", "ours, layered"
# Ours again with longer steps and a looser tolerance, which leave about their compression.
UNIFORM_LOOSER, LAYERED_LOOSER = "ours, uniform, looser", "ours, layered, looser"
OURS = (UNIFORM, LAYERED, UNIFORM_LOOSER, LAYERED_LOOSER)
WATER = (THEIRS, *OURS)


def work(task: dict) -> object:
    """What a process of its own does: a run of water as a dictionary, or the times of surfaces."""
    tank = Tank(tuple(task["counts"]), task["per_metre"])
    if task["kind"] == "surfaces":
        return peer_surfaces.measured(tank, task["rounds"], task["arch"])
    if task["kind"] == THEIRS:
        return asdict(peer_splishsplash.run(tank, task["seconds"], Path(task["folder"])))
    return asdict(peer_tank.run(tank, *(task[k] for k in ("layers", "looser", "seconds", "arch"))))


def in_process(kind: str, tank: Tank, folder: str, **task) -> object | None:
    """The same in a process of its own; None, and a line that says so, where it fails."""
    out = Path(folder) / "found.json"
    task |= {"kind": kind, "out": str(out), "folder": f"{folder}/{tank.per_metre}", **asdict(tank)}
    command = [sys.executable, __file__, "--worker", json.dumps(task)]
    done = subprocess.run(command, capture_output=True, text=True, errors="replace")
    # A peer may print what it likes, and crash once all is done.
    if not out.exists():
        why = done.stderr.strip().splitlines()[-1:] or [f"exit status {done.returncode}"]
        click.echo(f"{kind}, {tank.particles:,} particles: skipped, {why[0]}")
        return None
    found = json.loads(out.read_text())
    out.unlink()
    return found


def spread(values: list[float]) -> str:
    """Median, lowest and highest to two digits or whole numbers."""
    read = (float(np.median(values)), min(values), max(values))
    shown = [f"{v:.0f}" if v >= 10.0 else f"{v:.2g}" for v in read]
    return f"{shown[0]} ({shown[1]} to {shown[2]})" if len(values) > 1 else shown[0]


def percent(values: list[float], digits: int) -> str:
    """Mean of shares (-), those that are not known left out, as a percentage."""
    known = [v for v in values if not math.isnan(v)]
    return f"{100.0 * np.mean(known):.{digits}f} %" if known else "-"


def speeds(tank: Tank, seconds: float, runs: dict[str, list[Run]]) -> dict[str, str]:
    """A size's row: simulated over wall-clock time."""
    row = {"particles": f"{tank.particles:,}", "simulated s": f"{seconds:g}"}
    for kind in WATER:
        row[kind] = spread([run.speed for run in runs[kind]]) if runs[kind] else "-"
    theirs = [run.speed for run in runs[THEIRS]]
    for kind in OURS:
        ours = [run.speed for run in runs[kind]]
        known = theirs and ours
        row[f"{kind} / {THEIRS}"] = f"{np.median(ours) / np.median(theirs):.2f}" if known else "-"
    return row


def details(tank: Tank, runs: dict[str, list[Run]]) -> list[dict[str, str]]:
    """A size's rows, one for each water: errors, and what the speed is made of."""
    rows = []
    for kind in WATER:
        if runs[kind]:
            last = runs[kind][-1]
            compression = [c for run in runs[kind] for c in run.compression]
            rows.append(
                {
                    "block": f"{tank.particles:,}",
                    "water": kind,
                    "particles, start to end": f"{last.particles_start:,} to "
                    f"{last.particles_end:,}",
                    "compression, mean": percent(compression, 3),
                    "worst frame": percent([max(compression)], 3),
                    "bulk density - 1": percent(
                        [b - 1.0 for run in runs[kind] for b in run.bulk], 1
                    ),
                    "mean dt, ms": f"{1e3 * last.simulated / max(last.steps, 1):.2f}",
                    "iterations a step": f"{last.iterations / max(last.steps, 1):.1f}",
                    "us a particle and step": f"{_per_step(last):.2f}",
                }
            )
    return rows


def _per_step(run: Run) -> float:
    """Microseconds per particle and step."""
    return 1e6 * run.wall / max(run.steps, 1) / (0.5 * (run.particles_start + run.particles_end))


def surface_rows(found: dict) -> list[dict[str, str]]:
    """Rows of the surfaces' table."""
    rows = []
    for name, ways in found.items():
        peers = {way: np.median(t) for way, (_, t) in ways.items() if not way.startswith("ours")}
        for way, (count, times) in ways.items():
            fastest = min(peers.values(), default=math.nan) / np.median(times)
            rows.append(
                {
                    "surface": name,
                    "by": way,
                    "triangles": f"{count:,}",
                    "ms": spread(times),
                    "fastest peer's time over this": "-" if way in peers else f"{fastest:.1f}",
                }
            )
    return rows


def table(rows: list[dict[str, str]]) -> str:
    return tabulate(rows, headers="keys", tablefmt="github", disable_numparse=True)


class Report:
    """bench/results/peers.md, written anew with every row."""

    def __init__(self, arch: str, repeats: int, skipped: list[str]):
        self.title = heading("Beside other programs", arch) + load()
        self.repeats, self.skipped = repeats, skipped
        self.speeds: list[dict[str, str]] = []
        self.details: list[dict[str, str]] = []
        self.surfaces: list[dict[str, str]] = []
        self.settings: dict[str, str] = {}

    def write(self) -> str:
        """Writes it and returns it."""
        parts = [self.title, *(f"{line}.\n" for line in self.skipped)]
        if self.speeds:
            parts += [
                f"A block of about 1 m^3 collapses in a tank {peer_tank.LENGTH:g} m long and "
                f"{peer_tank.HEIGHT:g} m high. Simulated over wall-clock time: median of "
                f"{self.repeats} runs in turns (lowest to highest); starting, compiling and "
                "reading left out.\n",
                table(self.speeds),
                "\nCompression: mean over particles of max(rho/rho0 - 1, 0), rho by each method's "
                "own sums over the positions at the end of frames of 1/60 s. Bulk density: of all "
                "by msph/measure/bulk.py, a kernel away from surface and walls, mean over the time "
                "in which there is such water. Iterations: DFSPH's of its density solve, its "
                "divergence solve comes on top; ours of the velocity solve.\n",
                table(self.details),
                "\nSettings:\n",
                *(f"- {kind}: {text}" for kind, text in self.settings.items()),
                "",
            ]
        if self.surfaces:
            parts += [
                f"Surfaces; target: {SURFACE_TARGET:g} times as fast as the fastest peer. Ours "
                f"from particles sorted by the simulation; splashsurf without smoothing, smoothing "
                f"length {peer_surfaces.SMOOTHING_LENGTH:g} radii. {peer_surfaces.versions()}.\n",
                table(self.surfaces),
                "",
            ]
        text = "\n".join(parts)
        RESULTS.mkdir(exist_ok=True)
        (RESULTS / "peers.md").write_text(text)
        return text


def skipped_peers() -> list[str]:
    """A line for each peer that is missing."""
    names = [peer_splishsplash.MODULE] if peer_splishsplash.missing() else []
    names += peer_surfaces.missing()
    return [f"{name} is not installed: skipped (pip install '.[peers]')" for name in names]


@click.command()
@click.option("--repeats", default=3, show_default=True, type=click.IntRange(min=1))
@click.option("--seconds", default=2.0, show_default=True, help="Simulated time of a run.")
@click.option(
    "--starting", default=0.25, show_default=True, help="Of blocks too large for whole runs."
)
@click.option(
    "--most", default=TANKS[-1].particles, show_default=True, help="Particles of the largest block."
)
@click.option("--layers", default=3, show_default=True, help="Of our layered water.")
@click.option("--rounds", default=20, show_default=True, help="Of each surface.")
@click.option("--arch", type=click.Choice(ARCHES), default="cpu", show_default=True)
@click.option("--worker", hidden=True, help="A task as JSON: what it finds goes to its file.")
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
    """Measure and write bench/results/peers.md."""
    if worker is not None:
        task = json.loads(worker)
        found = json.dumps(work(task))
        Path(task["out"]).write_text(found)
        return
    report = Report(arch, repeats, skipped_peers())
    for line in report.skipped:
        click.echo(line)
    kinds = [kind for kind in WATER if kind != THEIRS or not peer_splishsplash.missing()]
    with tempfile.TemporaryDirectory() as folder:
        for tank in (t for t in TANKS if t.particles <= most):
            time = seconds if tank.particles <= WHOLE_RUNS else min(starting, seconds)
            runs: dict[str, list[Run]] = {kind: [] for kind in WATER}
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
