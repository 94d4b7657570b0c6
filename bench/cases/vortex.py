"""Vortices with vertical axes in a tank with free-slip walls: Taylor-Green and shear wave.

u = U (sin kx x cos kz z, 0, -kx/kz cos kx x sin kz z) decays as exp(-nu (kx^2 + kz^2) t), half a
wave along each edge; without viscosity its speed is constant. The error is the error of the
logarithm of the amplitude, which is proportional to the numerical viscosity. A plane shear wave
would flow through the walls; in a tank SHEAR_LENGTH times as long as wide the vortex is a shear
wave except at its ends. The tank has gravity and a free surface, because pressures cannot be
negative and the water would separate at the centre of the vortex. The energy lost to surface waves
is part of the error (SPEED).
"""

import functools

import numpy as np

from bench.cases.case import ADAPTIVE, UNIFORM, UNSHEARED, Case, Run, Setting, begin, stir, tank
from bench.water import Water

WIDTH, DEPTH, AIR = 1.0, 0.4, 0.3
# Speed U [m/s]. The formula is for a box with a lid. Under a free surface the pressure rho U^2/4
# (cos 2 pi x + cos 2 pi z) causes waves with up to U^2/(2 g D) of the energy at depth D: 0.4 % of
# the amplitude at 0.25 m/s, 6.4 % at 1 m/s (D = 0.4 m).
SPEED = 0.25
# Length of the tank of the shear wave [m].
SHEAR_LENGTH = 3.0
SETTLE = 2.0
# Number of layers at every resolution, so that the coarsest particles, which determine the error,
# are refined with the finest.
LAYERS = 2
# Kinematic viscosity [m^2/s] that halves the amplitude of the Taylor-Green vortex in READ [s]; time
# of the run without viscosity [s], in which the fastest water moves by 0.4 edges.
NU, READ, READ_INVISCID = 0.1, 0.35, 1.6
# Smallest share of the amplitude (-) that can be distinguished from random motion.
LEAST_SHARE = 1e-3


def vortex(x: np.ndarray, length: float = 1.0) -> np.ndarray:
    """Returns the vortex in a box of `length` [m] by 1 m at x (n, 3) [m]: (sin kx x cos kz z, 0,
    -kx/kz cos kx x sin kz z), kx = pi/length, kz = pi/1 m, (n, 3)."""
    sx, sz = np.pi * x[:, 0] / length, np.pi * x[:, 2]
    across = -np.cos(sx) * np.sin(sz) / length
    return np.stack([np.sin(sx) * np.cos(sz), 0.0 * sx, across], axis=1)


def amplitude(water: Water, length: float = 1.0) -> float:
    """Returns the amplitude U [m/s] of the vortex by least squares, weighted by mass; length [m] of
    the tank."""
    shape, m = vortex(water.positions(), length), water.masses()[:, None]
    return float((m * water.velocities() * shape).sum() / (m * shape**2).sum())


def measure(
    setting: Setting, nu: float, seconds: float, length: float = 1.0
) -> tuple[Run, dict[str, float]]:
    """Runs the vortex for `seconds` [s] at the kinematic viscosity nu [m^2/s] in a tank of `length`
    [m]; returns the run and the error (-) of the logarithm of the final over the initial
    amplitude."""

    def begin_tank(**more) -> Run:
        return begin(setting, tank(setting, (length, WIDTH), DEPTH, AIR, max_layers=LAYERS, **more))

    still = begin_tank()
    stir(still, SETTLE, setting.start)
    state = still.simulation.state()
    if nu:  # the stirred water has no viscosity, and so no change by it in its last step
        state["viscous_change"] = np.zeros_like(state["v"])
    # The next simulation reuses the fields of this one, whose kernels are compiled.
    still.simulation.close()
    run = begin_tank(projection={"viscosity": 1000.0 * nu})
    run.simulation.restore(state)
    run.water.set_velocities(run.water.velocities() + SPEED * vortex(run.water.positions(), length))
    begun = amplitude(run.water, length)
    run.go(seconds)
    left = max(amplitude(run.water, length) / begun, LEAST_SHARE)
    decay = nu * np.pi**2 * (1.0 / length**2 + 1.0 / WIDTH**2) * seconds
    return run, {"amplitude": abs(float(np.log(left)) + decay)}


def case(name: str, title: str, measure) -> Case:
    """Returns the case of a vortex."""
    return Case(
        name,
        title,
        "depth",
        {"amplitude": "logarithm of the amplitude of the vortex, against the formula"},
        (4, 6, 8, 12),
        measure,
        kinds=(UNIFORM, ADAPTIVE),
        classic=(),
        varied=(UNSHEARED,),
    )


TAYLOR_GREEN = case(
    "taylor_green",
    f"Taylor-Green vortex of {1000 * NU:g} Pa s, {READ:g} s",
    functools.partial(measure, nu=NU, seconds=READ),
)
SHEAR_WAVE = case(
    "shear_wave",
    f"Shear wave of {1000 * NU:g} Pa s in a tank of {SHEAR_LENGTH:g} m by {WIDTH:g} m, {READ:g} s",
    functools.partial(measure, nu=NU, seconds=READ, length=SHEAR_LENGTH),
)
INVISCID_VORTEX = case(
    "inviscid_vortex",
    f"Taylor-Green vortex without viscosity, {READ_INVISCID:g} s",
    functools.partial(measure, nu=0.0, seconds=READ_INVISCID),
)
