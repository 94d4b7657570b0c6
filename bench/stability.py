"""Stability: runs the hard cases and checks their requirements.

python bench/stability.py [--case NAME] [--resume] [--arch cpu]

Every row is a run in a separate process, written to bench/results/stability.csv when it ends;
--resume continues there. bench/results/stability.md is generated from this file.
"""

import datetime
import json
import math
import sys
from pathlib import Path

import click
import numpy as np
from tabulate import tabulate
from tqdm import tqdm

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from bench import rows
from bench.hard_cases import CASES, Hard
from bench.report import RESULTS, heading
from msph.device import ARCHES, start
from msph.errors import BlowUpError
from msph.fluid.external_forces import ExternalForces
from msph.fluid.trapped_water import TrappedWaterError
from msph.measure.bulk import bulk_density
from msph.measure.ledger import Ledger
from msph.measure.machine import machine
from msph.measure.timings import peak_memory
from msph.scene.build import build_simulation
from msph.scene.schema import Scene

TABLE, REPORT = "stability.csv", "stability.md"
# Limits (-): change of mass, energy rise in 1 s, momentum drift, mean solver residual, and bulk
# density error.
MASS, RISE, DRIFT, DENSITY, BULK = 1e-6, 1e-3, 1e-5, 0.01, 0.01
# Time of rest after the disturbance, and time between ledger entries in long runs [s].
REST, BETWEEN = 1.0, 1.0
# Largest growth of the memory of the process in one hour [MiB].
GROWTH = 20.0
REQUIREMENTS = """Requirements for the projection method: all values finite, no leaks, mass constant
to rounding, energy rise at most 0.1 % within 1 s without input, momentum drift at most 1e-5 of the
largest sum m |v|, and 1 s after the disturbance a mean solver residual and a bulk density error of
at most 1 %. Runs that cannot continue must end with a message that names the reason; until then
mass and momentum are conserved. The classic method may fail. Figures without a value (the bulk
density of a sheet; the energy rise without gravity or in less than 1 s) are not checked."""
# End of a run without an error.
FINISHED = "finished"
# Time limit of a run [s].
MAX_SECONDS = 2400.0


def run(case: Hard, method: str) -> dict[str, float | str]:
    """Runs a case; returns the figures of its ledger, and how it ended."""
    sim = build_simulation(Scene.model_validate(case.data(method)))
    sim.warm_up(1.0 / 60.0)
    ledger = Ledger(sim, density_every=math.inf)
    ledger.record(case.drive(0.0).gravity)
    before, ended = peak_memory(), FINISHED
    try:
        if case.change:
            case.change(sim)
            ledger.clear()
            ledger.record(case.drive(0.0).gravity)
        frames, skip = round(case.seconds / case.frame), 1
        if case.seconds > 100.0:
            skip = round(BETWEEN / case.frame)
        for k in range(frames):
            external = case.drive(k * case.frame)
            sim.advance(case.frame, external, free=True)
            if k % skip == 0:
                ledger.record(external.gravity)
        for _ in range(round(60 * REST)):
            sim.advance(1.0 / 60.0, ExternalForces(case.rest), free=True)
            ledger.record(case.rest)
    except (BlowUpError, TrappedWaterError) as error:
        ended = str(error)
    return {"ended": ended, **figures(sim, ledger, ended, peak_memory() - before)}


def figures(sim, ledger: Ledger, ended: str, growth: int) -> dict[str, float | str]:
    """Returns the figures of a run until now."""
    entries = ledger.entries
    mass = np.array([e.mass for e in entries])
    spacing = np.array([s.spacing for s in sim.layers.specs])[sim.particles.numpy("layer")]
    x = sim.particles.numpy("x").astype(float)
    finite = bool(np.isfinite(x).all())
    if finite and ended == FINISHED:
        sim.measure_density()
    excess = np.maximum(sim.particles.numpy("density") / 1000.0 - 1.0, 0.0)
    bulk = bulk_density(x, spacing, sim.size, sim.boundary.free).mean if finite else np.nan
    return {
        "particles": len(x),
        "steps": sim.steps,
        "outside": max(e.outside for e in entries),
        "mass": float(np.abs(mass / mass[0] - 1.0).max()),
        "energy_rise": ledger.energy_rise(),
        "momentum_drift": ledger.momentum_drift(),
        "density_end": float(excess.mean()),
        "density_largest": float(excess.max()),
        "bulk_end": float(bulk - 1.0),
        "top_speed": max(e.top_speed for e in entries),
        "kinetic": max(e.kinetic for e in entries),
        "growth_mib": growth / 2**20,
    }


def violations(case: Hard, found: dict) -> list[str]:
    """Returns the requirements that a run violates, in words; empty if it passes."""
    if found.get("failure"):
        return [str(found["failure"])]
    ended = str(found["ended"])
    as_named = ended.startswith(case.named) if case.named else ended == FINISHED
    problems = [] if as_named else [f"ended {ended}"]
    limits = {
        "outside": (0.0, "particles outside"),
        "mass": (MASS, "mass"),
        "momentum_drift": (DRIFT, "momentum"),
    }
    if not case.named:
        limits |= {
            "energy_rise": (RISE, "energy rise"),
            "kinetic": (case.kinetic, "kinetic energy"),
            "density_end": (DENSITY, "density"),
        }
    if case.settles and not case.named:
        limits["bulk_end"] = BULK, "bulk density"
    if case.seconds > 100.0:
        limits["growth_mib"] = (GROWTH, "memory growth")
    for name, (most, words) in limits.items():
        value = float(found[name])
        unknown = math.isnan(value) and name in ("bulk_end", "energy_rise")
        if not (abs(value) <= most or unknown):
            problems.append(f"{words} {value:.2g}")
    return problems


def in_process(name: str, method: str, arch: str) -> dict:
    """Returns a row of the table, measured in a separate process."""
    found = rows.in_process(__file__, {"case": name, "method": method, "arch": arch}, MAX_SECONDS)
    where = {"arch": arch, "machine": machine(), "date": datetime.date.today().isoformat()}
    return {"case": name, "method": method, **where, **found}


def report(known: list[dict], arch: str) -> bool:
    """Writes the report; returns True if the projection method passes all cases."""
    order = list(CASES)
    problems = {(row["case"], row["method"]): violations(CASES[row["case"]], row) for row in known}
    lines = [
        {
            "case": row["case"],
            "method": row["method"],
            "requirement": CASES[row["case"]].what,
            "result": "**fails**" if problems[row["case"], row["method"]] else "passes",
            "violations": "; ".join(problems[row["case"], row["method"]]),
            "energy rise, %": percent(row.get("energy_rise")),
            "momentum drift": digits(row.get("momentum_drift")),
            "solver residual at the end, %": percent(row.get("density_end")),
            "bulk density error at the end, %": percent(row.get("bulk_end")),
            "top speed, m/s": digits(row.get("top_speed")),
        }
        for row in sorted(known, key=lambda r: (order.index(r["case"]), r["method"] == "classic"))
    ]
    held = {
        method: [not found for (_, m), found in problems.items() if m == method]
        for method in ("projection", "classic")
    }
    total = (
        f"The projection method passes {sum(held['projection'])} of {len(held['projection'])} cases"
    )
    total += f", the classic method {sum(held['classic'])} of {len(held['classic'])}"
    requirements = REQUIREMENTS.replace("\n", " ")
    text = [heading("Hard cases", arch), requirements, f"\n**{total}.**\n"]
    text.append(tabulate(lines, headers="keys", tablefmt="github", disable_numparse=True))
    (RESULTS / REPORT).write_text("\n".join(text) + "\n", encoding="utf-8")
    click.echo(total)
    return all(held["projection"])


def digits(value: str | float | None) -> str:
    """Formats a number with two digits; "" if it is unknown."""
    return f"{float(value):.2g}" if value not in (None, "") else ""


def percent(value: str | float | None) -> str:
    """Formats a ratio in percent; "" if it is unknown."""
    number = float(value) if value not in (None, "") else math.nan
    return "" if math.isnan(number) else f"{100.0 * number:.3f}"


@click.command()
@click.option(
    "--case",
    "names",
    multiple=True,
    type=click.Choice(list(CASES)),
    help="Run only this case. Repeatable.",
)
@click.option("--resume", is_flag=True, help="Keep the rows of earlier runs.")
@click.option("--arch", type=click.Choice(ARCHES), default="auto", show_default=True)
@click.option("--worker", hidden=True)
def main(names, resume, arch, worker) -> None:
    """Run the hard cases and write bench/results/stability.{csv,md}."""
    if worker:
        task = json.loads(worker)
        start(task["arch"])
        print(json.dumps(run(CASES[task["case"]], task["method"])))
        return
    arch = start(arch)
    requested = [
        (name, method)
        for name in names or CASES
        for method in ("projection", "classic")
        if method == "projection" or CASES[name].classic
    ]
    known = rows.read(RESULTS / TABLE)
    if not resume:
        known = [row for row in known if (row["case"], row["method"]) not in requested]
    done = {(row["case"], row["method"]) for row in known}
    for name, method in tqdm([a for a in requested if a not in done], unit="run"):
        known.append(in_process(name, method, arch))
        rows.write(RESULTS / TABLE, known)
    if not report(known, arch):
        sys.exit(1)


if __name__ == "__main__":
    main()
