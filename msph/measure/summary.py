"""The summary of a run: what was measured where, how fast it was, and every error beside it."""

import datetime
import json
import math
import platform
from pathlib import Path
from typing import Any

import numpy as np
import taichi as ti

import msph
from msph.fluid.simulation import Simulation
from msph.measure import account, survey
from msph.measure.ledger import Ledger
from msph.measure.machine import machine
from msph.measure.survey import Survey
from msph.measure.timings import Timings
from msph.own_files import replace
from msph.scene.schema import Scene
from msph.scene.water import asked_mass


def origin(scene: Scene, name: str, arch: str) -> dict[str, Any]:
    """Scene, machine, versions and date of a run."""
    return {
        "scene": name,
        "title": scene.title,
        "method": scene.method,
        "date": datetime.datetime.now().astimezone().isoformat(timespec="seconds"),
        "machine": machine(),
        "arch": arch,
        "msph": msph.__version__,
        "taichi": ".".join(map(str, ti.__version__)),
        "python": platform.python_version(),
    }


def water_laid(scene: Scene, simulation: Simulation, started: list[int]) -> dict[str, float]:
    """Mass [kg] that the scene asks for beside that of the particles of each layer at the start.

    What bodies displaced is not asked for. The error is a share (-).
    """
    asked = asked_mass(scene, simulation.plan.specs) - simulation.mass_left_out
    laid = sum(n * s.mass for n, s in zip(started, simulation.layers.specs, strict=True))
    return {"mass_asked_kg": asked, "mass_laid_kg": laid, "mass_laid_error": laid / asked - 1.0}


def progress(
    simulation: Simulation, started: list[int], frame_s: float, first_step: int = 0
) -> dict[str, Any]:
    """How far a run came that began, or was gone on with, at `first_step`; particles of each layer
    then and at its end."""
    done = simulation.steps - first_step
    return {
        "simulated_s": simulation.time,
        "frame_s": frame_s,
        "steps": simulation.steps,
        "iterations_per_step": simulation.iterations / done if done else math.nan,
        "particles_start": started,
        "particles_end": simulation.counts(),
    }


def speed(timings: Timings, frame_s: float) -> dict[str, float]:
    """Quartiles of the fluid's wall-clock time per frame [ms], and simulated over wall-clock time.

    What measuring itself took is left out.
    """
    if not timings.frames:
        return {}
    quartiles = {f"frame_ms_p{p}": 1e3 * timings.percentile(p) for p in (25, 50, 75)}
    return {**quartiles, "simulated_per_wall": len(timings.frames) * frame_s / timings.total()}


def errors(ledger: Ledger, surveys: list[Survey]) -> dict[str, float]:
    """Every error figure of a run, shares (-) but for merge_loss_J [J]; see Ledger and Survey."""
    if not ledger.entries:
        return {}
    mean, p99, largest = ledger.density_error()
    first, last = ledger.entries[0], ledger.entries[-1]
    return {
        "mass_change": last.mass / first.mass - 1.0,
        "momentum_drift": ledger.momentum_drift(),
        "angular_momentum_drift": ledger.angular_drift(),
        "energy_gain": ledger.energy_gain(),
        "energy_rise_in_1_s": ledger.energy_rise(1.0),
        "merge_loss_J": last.merge_loss,
        "density_error_mean": mean,
        "density_error_p99": p99,
        "density_error_max": largest,
        **survey.errors(surveys),
        "outside_most": max(e.outside for e in ledger.entries),
    }


def judged(
    scene: Scene, ledger: Ledger, surveys: list[Survey], found: dict[str, float]
) -> dict[str, Any]:
    """Resolution of a run, the limits that good runs keep, and in words what of its resolution and
    its errors `found` is beyond them."""
    # Here, since only measured runs need it, and trimesh is slow to import.
    from msph.measure.resolution import mean_depth, resolution

    centres = np.array([e.centre for e in ledger.entries])
    plan = ledger.simulation.plan
    resolved = resolution(plan, mean_depth(scene.gravity, plan, centres))
    lines = account.account({**resolved, **found})
    return {
        "resolution": resolved,
        "limits": account.limits(lines),
        "cautions": account.cautions(lines, survey.shortfall(surveys)),
    }


def figures(summary: dict[str, Any]) -> dict[str, float]:
    """All figures of a summary that an account may show."""
    return {**summary["resolution"], **summary["errors"]}


def write(path: Path, summary: dict[str, Any]) -> None:
    """Writes it as JSON; what is not known (NaN) is null."""
    text = json.dumps(_known(summary), indent=2, ensure_ascii=False, allow_nan=False)
    replace(path, text + "\n")


def _known(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: _known(v) for k, v in value.items()}
    if isinstance(value, list):
        return [_known(v) for v in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
