"""First sloshing mode of a tank: period, and decay by viscosity.

omega^2 = g k tanh(k H), k = pi/L. Between free-slip walls the velocities of a standing wave of
small viscosity decay as exp(-2 nu k^2 t), at any depth: dissipation is mu times the integral of the
normal derivative of |u|^2 over the surface of an irrotational flow, which vanishes at walls (Lamb
1932, art. 329, 348).
"""

import functools
import math

import numpy as np

from bench import tanks
from bench.cases.case import ADAPTIVE, UNIFORM, UNSHEARED, Case, Run, Setting, begin, tank

LENGTH, WIDTH, DEPTH, AIR = 1.0, 0.35, 0.5, 0.3
# Depth of the deep tank [m]: the motion at the floor is 0.004 times the motion at the surface.
# Tanks are wider than the coarsest support, 0.31 m and 0.62 m.
DEEP, DEEP_WIDTH = 2.0, 0.65
# Amplitude [m]: the error of linear theory is 0.1 %.
AMPLITUDE = 0.025
SETTLE, READ = 1.0, 5.0
# Viscosity [Pa s] that halves velocities in 1.8 s; numerical damping is small in comparison.
VISCOSITY = 20.0


def measure(
    setting: Setting, depth: float = DEPTH, width: float = WIDTH, viscosity: float = 0.0
) -> tuple[Run, dict[str, float]]:
    """Runs a tank of `width` [m] with water `depth` [m] deep of a viscosity [Pa s]; returns the run
    and its errors."""
    terms = {"projection": {"viscosity": viscosity}} if viscosity else {}
    run = begin(setting, tank(setting, (LENGTH, width), depth, AIR, **terms))
    run.go(SETTLE)
    tanks.slosh(run.water, depth, AMPLITUDE)
    reading, masses, begun = tanks.Reading(run.water), run.water.masses(), run.water.time
    speed = float((masses * run.water.velocities()[:, 0]).sum() / masses.sum())
    at_rest = run.water.centre()[0]
    run.go(READ, reading.read)
    x, times = np.array(reading.centres)[:, 0], np.array(reading.times) - begun
    expected = tanks.slosh_period(LENGTH, depth)
    decay = 2.0 * viscosity / 1000.0 * (math.pi / LENGTH) ** 2
    omega, early = 2.0 * math.pi / expected, times <= 2.0 * expected
    theory = speed / omega * np.exp(-decay * times) * np.sin(omega * times)
    apart = np.sqrt(np.mean((x - at_rest - theory)[early] ** 2) / np.mean(theory[early] ** 2))
    rate, period = tanks.fitted_wave(times, x, expected)
    errors = {
        "wave": float(apart),
        "period": abs(period / expected - 1.0),
        "energy_rise": reading.energy_rise(),
        "energy_rise_of_motion": reading.energy_rise_of_motion(),
    }
    if viscosity:
        return run, {**errors, "decay": abs(rate / decay - 1.0)}
    height = abs(reading.volume_error())
    return run, {**errors, "damping": abs(rate) / omega, "height": height}


ENERGY = "largest rise of the energy in 1 s, over the potential energy"
OF_MOTION = "the same, over the largest kinetic plus available potential energy (above level water)"
WAVE = (
    "rms difference of the centre of mass from theory over two periods, over the rms displacement"
)
PERIOD = "period of the first mode against linear theory"
INVISCID = {
    "wave": WAVE,
    "period": PERIOD,
    "damping": "damping ratio of water without viscosity, 0 by theory",
    "height": "height of the centre of mass against H/2, over H/2",
    "energy_rise": ENERGY,
    "energy_rise_of_motion": OF_MOTION,
}
SLOSHING = Case(
    "sloshing",
    f"Sloshing of a tank {LENGTH:g} m long, {DEPTH:g} m deep",
    "depth",
    INVISCID,
    (5, 7, 10, 15, 25),
    measure,
    summary=("wave",),
    varied=(UNSHEARED,),
    peer=("wave", "damping", "period"),
)
DEEP_SLOSHING = Case(
    "deep_sloshing",
    f"Sloshing of a tank {LENGTH:g} m long, {DEEP:g} m deep",
    "depth",
    INVISCID,
    (20, 28, 40, 60, 14),  # the middle one, at which settings are varied, is 40
    functools.partial(measure, depth=DEEP, width=DEEP_WIDTH),
    kinds=(UNIFORM, ADAPTIVE),
    classic=(),
    summary=("wave",),
    varied=(UNSHEARED,),
)
STANDING_WAVE = Case(
    "standing_wave",
    f"Sloshing of a liquid of {VISCOSITY:g} Pa s, {DEPTH:g} m deep",
    "depth",
    {
        "wave": WAVE,
        "decay": "rate of decay against 2 nu k^2",
        "period": PERIOD,
        "energy_rise": ENERGY,
        "energy_rise_of_motion": OF_MOTION,
    },
    (7, 10, 15),
    functools.partial(measure, viscosity=VISCOSITY),
    kinds=(UNIFORM, ADAPTIVE),
    classic=(),
    varied=(UNSHEARED,),
)
