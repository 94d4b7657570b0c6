"""Summary of a run: scene, machine, speed and errors."""

import datetime
import math
import platform
from typing import Any

import numpy as np
import taichi as ti

from msph.constants import VERSION
from msph.fluid.projection.parameters import ProjectionParameters
from msph.fluid.simulation import Simulation
from msph.measure import account, survey
from msph.measure.ledger import Ledger
from msph.measure.machine import machine
from msph.measure.resolution import mean_depth, resolution
from msph.measure.survey import Survey
from msph.measure.timings import Timings
from msph.scene.schema import Scene
from msph.scene.water import specified_mass


def origin(scene: Scene, name: str, arch: str) -> dict[str, Any]:
    """Returns the scene, machine, versions and date of a run."""
    return {
        "scene": name,
        "title": scene.title,
        "method": scene.method,
        "date": datetime.datetime.now().astimezone().isoformat(timespec="seconds"),
        "machine": machine(),
        "arch": arch,
        "msph": VERSION,
        "taichi": ".".join(map(str, ti.__version__)),
        "python": platform.python_version(),
    }


def water_mass(scene: Scene, simulation: Simulation) -> dict[str, float]:
    """Returns the mass [kg] of water in the scene file, less the mass displaced by bodies, the mass
    of its particles at time zero, and the relative error (-). Water in the pipes of inflows is in
    neither."""
    asked = specified_mass(scene, simulation.plan.specs) - simulation.mass_left_out
    masses = np.array([s.mass for s in simulation.layers.specs])
    laid = float(masses[simulation.initial["layer"]].sum())
    return {"mass_asked_kg": asked, "mass_laid_kg": laid, "mass_laid_error": laid / asked - 1.0}


def progress(
    simulation: Simulation, started: list[int], frame_s: float, first_step: int = 0
) -> dict[str, Any]:
    """Returns the time and steps of a run that started or resumed at `first_step`, the numbers of
    particles per layer at its start and end, and the masses [kg] that left an open box and flowed
    through inflows and outflows."""
    done = simulation.steps - first_step
    return {
        "simulated_s": simulation.time,
        "frame_s": frame_s,
        "steps": simulation.steps,
        "iterations_per_step": simulation.iterations / done if done else math.nan,
        "particles_start": started,
        "particles_end": simulation.counts(),
        "spilt_kg": simulation.rim.mass,
        "inflow_kg": simulation.world.parts.impulses.inflow_mass.total[None],
        "outflow_kg": simulation.rim.outflow,
    }


def speed(timings: Timings, frame_s: float) -> dict[str, float]:
    """Returns the quartiles of the elapsed time per frame [ms] and the real-time factor (-), both
    without the time of measuring."""
    if not timings.frames:
        return {}
    quartiles = {f"frame_ms_p{p}": 1e3 * timings.percentile(p) for p in (25, 50, 75)}
    return {**quartiles, "simulated_per_wall": len(timings.frames) * frame_s / timings.total()}


def errors(ledger: Ledger, surveys: list[Survey]) -> dict[str, float]:
    """Returns all errors of a run, relative (-) except merge_loss_J [J]; see Ledger and Survey."""
    if not ledger.entries:
        return {}
    mean, p99, largest = ledger.solver_residual()
    last = ledger.entries[-1]
    gains = ledger.energy_gain(), ledger.energy_gain(ledger.motion_energy()), ledger.energy_rise()
    parameters = ledger.simulation.plan.parameters
    if isinstance(parameters, ProjectionParameters) and parameters.tension > 0.0:
        # The surface gives and takes energy that no sum over particles tells from their arrangement
        # (docs/trials.md).
        gains = (math.nan,) * 3
    return {
        "mass_change": ledger.mass_change(),
        "momentum_drift": ledger.momentum_drift(),
        "angular_momentum_drift": ledger.angular_drift(),
        "energy_gain": gains[0],
        "energy_gain_of_motion": gains[1],
        "energy_rise_in_1_s": gains[2],
        "merge_loss_J": last.merge_loss,
        "solver_residual_mean": mean,
        "solver_residual_p99": p99,
        "solver_residual_max": largest,
        **survey.errors(surveys),
        "outside_most": max(e.outside for e in ledger.entries),
    }


def assessment(
    scene: Scene, ledger: Ledger, surveys: list[Survey], found: dict[str, float]
) -> dict[str, Any]:
    """Returns the resolution of a run, the limits of resolution and errors `found`, and cautions
    for those outside their limits."""
    centres = np.array([e.centre for e in ledger.entries])
    plan = ledger.simulation.plan
    resolved = resolution(plan, mean_depth(scene.gravity, plan, centres))
    lines = account.account({**resolved, **found})
    waited = ledger.simulation.openings.message()
    return {
        "resolution": resolved,
        "limits": {line.key: line.figure.limit for line in lines},
        "cautions": account.cautions(lines, survey.shortfall(surveys)) + [waited] * bool(waited),
    }
