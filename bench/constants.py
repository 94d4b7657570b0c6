"""Effect of each constant of the projection method on errors, steps and particles.

Two simulations per value: layered water at rest, 30 fine spacings deep, and the shipped dam break.
A constant that changes no figure within a factor of 2 needs no tuning.
"""

import importlib
from functools import partial
from typing import Any

import numpy as np

from bench import tanks
from bench.tables import Bench, Table
from msph.fluid.external_forces import ExternalForces
from msph.scene import load_scene

FLUID = "msph.fluid."
# Settings under which the constants of surface tension, of viscosity, and of a pool of particles
# near its capacity have an effect.
TENSE = ("projection.tension=0.5",)
VISCOUS = ("projection.viscosity=100.0",)
CROWDED = ("adaptation.capacity=2600",)
# Module and name of a constant, or "scene" and the key of a parameter; values to compare with the
# default; settings that the constant needs to have an effect.
TRIED: list[tuple[str, str, tuple[Any, ...], tuple[str, ...]]] = [
    ("projection.solver", "ARRANGED_EXCESS", (1e-4, 1e-2), ()),
    ("projection.position_correction", "SPRAY_MOTION_FACTOR", (1.25, 5.0), ()),
    ("scene", "projection.longest_step", (1 / 120, 1 / 30), ()),
    ("scene", "projection.release", (0.1, 1.6), ()),
    ("scene", "projection.velocity_iterations", (10, 30, 400), ()),
    ("scene", "projection.position_iterations", (2, 8), ()),
    ("scene", "projection.largest_shift", (0.1, 0.5), ()),
    ("scene", "projection.spray", (0.2, 0.6), ()),
    ("projection.density", "SURROUNDED", (0.99, 0.999), ()),
    ("projection.density", "REST_DEFECT", (0.0, 0.01), ()),
    ("projection.density", "MAX_CORRECTION", (0.03, 0.12), ()),
    ("projection.position_correction", "BACKGROUND_DEFICIT", (0.01, 0.1), ()),
    ("boundary.contact", "NEAREST", (0.01, 0.2), ()),
    ("projection.pressure_solve", "MAX_START_SCALE", (1.0, 4.0), ()),
    ("projection.pressure_solve", "MIN_DISPLACEMENT", (1e-6, 1e-4), ()),
    ("projection.conjugate_gradient", "LAUNCH_ITERATIONS_CPU", (2, 4), ()),
    ("projection.conjugate_gradient", "MAX_ROUND_ITERATIONS", (20, 80), ()),
    ("projection.surface_tension", "CAPILLARY_FACTOR", (0.25, 1.0), TENSE),
    ("projection.viscosity", "TOLERANCE", (1e-4, 1e-2), VISCOUS),
    ("scene", "adaptation.band", (0.8, 2.0), ()),
    ("scene", "adaptation.hysteresis", (0.1, 0.4), ()),
    ("scene", "adaptation.every", (4, 16), ()),
    ("scene", "adaptation.budget", (0.03, 0.3), ()),
    ("scene", "adaptation.settle", (1, 6), ()),
    ("adaptivity.adaptation", "SPLIT_OFFSET", (0.25, 0.45), ()),
    ("adaptivity.adaptation", "MIN_SPLIT_OFFSET", (0.08, 0.3), ()),
    ("adaptivity.adaptation", "MAX_MERGE_DISTANCE", (1.0, 1.6), ()),
    ("adaptivity.adaptation", "SHRINK_ABOVE", (0.85, 0.99), CROWDED),
    ("adaptivity.adaptation", "GROW_BELOW", (0.7, 0.94), CROWDED),
    ("adaptivity.adaptation", "SHRINK", (0.8, 0.95), CROWDED),
    ("adaptivity.adaptation", "GROW", (1.01, 1.05), CROWDED),
    ("adaptivity.adaptation", "MIN_THICKNESS", (0.05, 0.3), CROWDED),
    ("adaptivity.surface_distance", "COVERED", (0.25, 0.45), ()),
    ("adaptivity.surface_distance", "CELL", (0.4, 0.9), ()),
]
# Water at rest: finest spacing [m], depth in spacings, layers, times to settle and to measure [s].
FINE, SPACINGS_DEEP, LAYERS, SETTLE, READ = 0.02, 30, 4, 0.5, 0.5
# Frames of the dam break: until the water has climbed the far wall.
FRAMES = 36


def run(
    module: str, name: str, value: Any, settings: tuple[str, ...], start: int
) -> dict[str, float]:
    """Runs both simulations with one constant changed, with none if module is ""; returns their
    figures."""
    if module == "scene":
        settings = (*settings, f"{name}={value}")
    elif module:
        found = importlib.import_module(FLUID + module)
        if not hasattr(found, name):
            raise AttributeError(f"{FLUID}{module} has no {name}: a run would change nothing")
        setattr(found, name, value)
    return at_rest(settings, start) | dam_break((*settings, f"seed={start}"))


def at_rest(settings: tuple[str, ...], start: int) -> dict[str, float]:
    """Returns the figures of still water: pressure error against rho g (H - y), energy rise in 1 s,
    mean solver residual (-); kinetic energy [mJ]; number of particles that changed layer."""
    scene = tanks.tank((10 * FINE, 10 * FINE), SPACINGS_DEEP * FINE, FINE, LAYERS, seed=start)
    sim = tanks.build(load_scene(scene.model_dump(), settings))
    tanks.run(sim, SETTLE)
    reading = tanks.Reading(sim)
    profile, counts = tanks.Profile(sim, reading.depth), np.array(sim.counts())
    tanks.run(sim, READ, reading, profile)
    return {
        "pressure at rest": profile.error(),
        "energy rise at rest": reading.energy_rise(),
        "solver residual at rest": float(np.mean(reading.error_mean)),
        "kinetic energy at rest, mJ": 1e3 * float(np.mean(reading.kinetic)),
        "changed layer": float(np.abs(counts - sim.counts()).sum()),
    }


def dam_break(settings: tuple[str, ...]) -> dict[str, float]:
    """Returns the figures of the dam break: means over frames of the mean and the 99th percentile
    of the solver residual, and its maximum (-); worst bulk density error (-); final over initial
    energy (-); numbers of steps, of iterations of the pressure solve, and of particles at the
    end."""
    sim = tanks.build(load_scene("dam_break", settings))
    reading, bulk = tanks.Reading(sim), []
    reading.read()
    for frame in range(FRAMES):
        sim.advance(tanks.FRAME, ExternalForces())
        reading.read()
        if frame % 6 == 5:
            bulk.append(reading.water.bulk_density() - 1.0)
    return {
        "solver residual, mean": float(np.mean(reading.error_mean)),
        "99th percentile": float(np.mean(reading.error_p99)),
        "largest": max(reading.error_max),
        "bulk density, worst": float(max(bulk, key=lambda b: 0.0 if np.isnan(b) else abs(b))),
        "energy left": reading.energies[-1] / reading.energies[0],
        "steps": float(sim.steps),
        "iterations": float(sim.iterations),
        "particles": float(sim.particles.count),
    }


def cases() -> dict[tuple[str, str], partial]:
    """Returns the runs, with two of the defaults for each of the settings."""
    found = {}
    for settings in dict.fromkeys(s for *_, s in TRIED):
        given = ", ".join(settings)
        for name in ("defaults", "defaults, second run"):
            found[name, given] = partial(run, "", name, 0, settings)
        for module, name, values, own in TRIED:
            for value in values if own == settings else ():
                tried = partial(run, module, name, value, settings)
                found[f"`{name}` = {value:.4g}", given] = tried
    return found


FORMS = {
    "pressure at rest": ".3%",
    "energy rise at rest": ".3%",
    "solver residual at rest": ".3%",
    "kinetic energy at rest, mJ": ".3g",
    "changed layer": ".0f",
    "solver residual, mean": ".3%",
    "99th percentile": ".3%",
    "largest": ".3%",
    "bulk density, worst": ".3%",
    "energy left": ".3%",
    "steps": ".0f",
    "iterations": ".0f",
    "particles": ".0f",
}
BENCHES = {
    "constants": Bench(
        "Constants of the projection method",
        "The two rows of defaults show the variation between runs: threads add numbers in varying "
        "order.\n",
        {
            "constants": Table(
                f"Layered water at rest, {SPACINGS_DEEP} fine spacings deep, {READ:g} s after "
                f"{SETTLE:g} s; and the shipped dam break, {FRAMES} frames",
                ("constant", "setting"),
                cases(),
                FORMS,
                starts=1,
            )
        },
    )
}
