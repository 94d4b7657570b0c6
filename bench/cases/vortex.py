"""Vortices about the vertical that fill a tank of free-slip walls: Taylor-Green, and a shear wave.

u = U (sin kx x cos kz z, 0, -kx/kz cos kx x sin kz z) decays as exp(-nu (kx^2 + kz^2) t), half a
wave along each edge; without viscosity it keeps its speed. The error is that of the amplitude's
logarithm, which is proportional to the numerical viscosity; the share of the amplitude that is lost
saturates at 1. A plane shear wave would flow through walls: in a tank SHEAR_LENGTH times as long as
wide the vortex is one but for its ends. Under gravity and a free surface, for the method's
pressures only push: without weight the water would part in the vortex's middle. What the surface
takes is part of the error (terms.VORTEX_SPEED).
"""

import functools

import numpy as np

from bench.cases.case import ADAPTIVE, UNIFORM, Case, Run, Setting, begin, stir, tank
from bench.terms import VORTEX_SPEED, set_velocity, vortex

WIDTH, DEPTH, AIR = 1.0, 0.4, 0.3
# Length of the tank of the shear wave [m].
SHEAR_LENGTH = 3.0
SETTLE = 2.0
# The flow fills the depth, so its error is that of the coarsest particles: these refine with the
# finest while the number of layers stays.
LAYERS = 2
# Kinematic viscosity [m^2/s] by which Taylor and Green's vortex loses half of its amplitude in READ
# [s]. In READ_INVISCID [s], without viscosity, the fastest water goes .4 of the edge.
NU, READ, READ_INVISCID = 0.1, 0.35, 1.6
# Least share of the amplitude (-) that differs from the particles' own motion.
LEAST_SHARE = 1e-3


def amplitude(run: Run, length: float = 1.0) -> float:
    """Amplitude U [m/s] of the vortex, by least squares weighted by mass; length [m] of tank."""
    shape, m = vortex(run.places(), length), run.masses()[:, None]
    return float((m * run.velocities() * shape).sum() / (m * shape**2).sum())


def share_left(
    setting: Setting, nu: float, seconds: float, length: float = 1.0
) -> tuple[Run, float]:
    """A run of `seconds` [s] at the kinematic viscosity nu [m^2/s] in a tank of `length` [m], and
    the share of the vortex's amplitude (-) that is left."""

    def water(**more) -> Run:
        return begin(tank(setting, (length, WIDTH), DEPTH, AIR, most_layers=LAYERS, **more))

    still = water()
    stir(still, SETTLE)
    run = water(projection={"viscosity": 1000.0 * nu})
    run.simulation.restore(still.simulation.state())
    set_velocity(run.simulation, run.velocities() + VORTEX_SPEED * vortex(run.places(), length))
    begun = amplitude(run, length)
    run.go(seconds)
    return run, amplitude(run, length) / begun


def off(found: float, decay: float) -> float:
    """Error of the logarithm of the share `found` of the amplitude that is left, against -decay
    (-)."""
    return abs(float(np.log(max(found, LEAST_SHARE))) + decay)


def viscous(setting: Setting, length: float = 1.0) -> tuple[Run, dict[str, float]]:
    run, found = share_left(setting, NU, READ, length)
    rate = NU * np.pi**2 * (1.0 / length**2 + 1.0 / WIDTH**2)
    return run, {"amplitude": off(found, rate * READ)}


def inviscid(setting: Setting) -> tuple[Run, dict[str, float]]:
    run, found = share_left(setting, 0.0, READ_INVISCID)
    return run, {"amplitude": off(found, 0.0)}


def case(name: str, title: str, measure) -> Case:
    """A vortex as a case: its amplitude against the formula."""
    return Case(
        name,
        title,
        "depth",
        {"amplitude": "logarithm of the vortex's amplitude, against the formula's"},
        (4, 6, 8, 12),
        measure,
        waters=(UNIFORM, ADAPTIVE),
        classic=(),
        sheared=True,
    )


TAYLOR_GREEN = case(
    "taylor_green", f"Taylor-Green vortex of {1000 * NU:g} Pa s, {READ:g} s", viscous
)
SHEAR_WAVE = case(
    "shear_wave",
    f"Shear wave of {1000 * NU:g} Pa s in a tank of {SHEAR_LENGTH:g} m by {WIDTH:g} m, {READ:g} s",
    functools.partial(viscous, length=SHEAR_LENGTH),
)
INVISCID_VORTEX = case(
    "inviscid_vortex", f"Taylor-Green vortex without viscosity, {READ_INVISCID:g} s", inviscid
)
