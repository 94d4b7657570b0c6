"""Stability: runs the hard cases and checks their requirements."""

import math
from functools import partial

import numpy as np

from bench.hard_cases import CASES, Hard
from bench.tables import Bench, Table, markdown
from bench.water import Ours
from msph.errors import BlowUpError
from msph.fluid.external_forces import ExternalForces
from msph.fluid.trapped_water import TrappedWaterError
from msph.measure.ledger import Ledger
from msph.measure.timings import peak_memory
from msph.scene.build import build_simulation

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


def run(case: Hard, method: str, seed: int = 0) -> dict[str, float | str]:
    """Runs a case; returns the figures of its ledger, and how it ended."""
    sim = build_simulation(case.build(method, seed))
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
    water = Ours(sim)
    finite = bool(np.isfinite(water.positions()).all())
    if finite and ended == FINISHED:
        sim.measure_density()
    excess = np.maximum(sim.particles.numpy("density") / 1000.0 - 1.0, 0.0)
    bulk = water.bulk_density() if finite else np.nan
    return {
        "particles": water.count,
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


def verdict(known: list[dict]) -> list[str]:
    """Returns the number of cases that pass, and the requirements that the others violate."""
    lines, passed = [], {"projection": [], "classic": []}
    for row in known:
        name, method = row["case"].split(" | ")
        problems = violations(CASES[name], row)
        passed[method].append(not problems)
        line = {"case": name, "method": method, "requirement": CASES[name].what}
        lines += [line | {"violations": "; ".join(problems)}] if problems else []
    good = [f"{sum(found)} of {len(found)} cases" for found in passed.values()]
    total = f"**The projection method passes {good[0]}, the classic method {good[1]}.**\n"
    return ["## Failed cases\n", total, markdown(lines)]


FORMS = {
    "particles": ",.0f",
    "steps": ",.0f",
    "outside": ".0f",
    "mass": ".0e",
    "energy_rise": ".3%",
    "momentum_drift": ".1e",
    "density_end": ".3%",
    "density_largest": ".1%",
    "bulk_end": ".3%",
    "top_speed": ".2g",
    "kinetic": ".2g",
    "growth_mib": ".0f",
}
BENCHES = {
    "stability": Bench(
        "Hard cases",
        REQUIREMENTS,
        {
            "cases": Table(
                "Figures of each case; density: solver residual; bulk: bulk density error",
                ("case", "method"),
                {
                    (name, method): partial(run, case, method)
                    for name, case in CASES.items()
                    for method in ("projection", "classic")
                    if method == "projection" or case.classic
                },
                FORMS,
                starts=1,
            )
        },
        verdict,
    )
}
