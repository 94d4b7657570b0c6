"""The Taylor-Green vortex about the vertical, in a tank 1 m by 1 m with free-slip walls.

u = (sin(pi x) cos(pi z), 0, -cos(pi x) sin(pi z)) decays as exp(-2 nu pi^2 t); without viscosity
all decay is error. Under gravity and a free surface, for the method's pressures only push: without
weight the water would part in the vortex's middle.
"""

import numpy as np

from bench import tanks
from bench.cases.case import ADAPTIVE, UNIFORM, Case, Run, Setting, begin, tank
from bench.terms import amplitude, set_velocity, vortex

DEPTH, AIR = 0.4, 0.3
# Random velocities [m/s] by which water loses its lattice, which resists shear, and time to rest.
STIR, SETTLE = 0.3, 1.0
# Kinematic viscosity [m^2/s] by which half of the vortex is lost in the time read [s].
NU, READ = 0.1, 0.35


def stirred(setting: Setting) -> dict[str, np.ndarray]:
    """Places [m] and layers of water that has lost its lattice and come to rest."""
    run = begin(tank(setting, (1.0, 1.0), DEPTH, AIR))
    sim, rng = run.simulation, np.random.default_rng(1)
    set_velocity(sim, rng.normal(0.0, STIR, (sim.particles.count, 3)))
    run.go(SETTLE)
    return {name: sim.particles.numpy(name) for name in ("x", "layer")}


def spin(setting: Setting, nu: float) -> tuple[Run, float, float]:
    """The run, and the shares of the amplitude and of the energy of the vortex that are left."""
    water = stirred(setting)
    scene = tank(setting, (1.0, 1.0), DEPTH, AIR, projection={"viscosity": 1000.0 * nu})
    run = begin(scene, water)
    sim = run.simulation
    # Without pressures to begin with, the water would fall.
    run.go(tanks.FRAME)
    rest = run.energy()
    set_velocity(sim, vortex(run.places()))
    start, begun = amplitude(sim), run.energy() - rest
    run.go(READ)
    return run, amplitude(sim) / start, (run.energy() - rest) / begun


def viscous(setting: Setting) -> tuple[Run, dict[str, float]]:
    run, left, _ = spin(setting, NU)
    return run, {"amplitude": abs(left / np.exp(-2.0 * np.pi**2 * NU * READ) - 1.0)}


def inviscid(setting: Setting) -> tuple[Run, dict[str, float]]:
    run, left, energy = spin(setting, 0.0)
    return run, {"amplitude": abs(left - 1.0), "energy": abs(energy - 1.0)}


LEFT = "amplitude of the vortex that is left, against the formula"
TAYLOR_GREEN = Case(
    "taylor_green",
    f"Taylor-Green vortex of {1000 * NU:g} Pa s, {READ:g} s",
    "depth",
    {"amplitude": LEFT},
    (4, 6, 8),
    viscous,
    waters=(UNIFORM, ADAPTIVE),
    classic=(),
    sheared=True,
)
INVISCID_VORTEX = Case(
    "inviscid_vortex",
    f"Taylor-Green vortex without viscosity, {READ:g} s",
    "depth",
    {"amplitude": LEFT, "energy": "energy of the vortex that is lost"},
    (4, 6, 8),
    inviscid,
    waters=(UNIFORM, ADAPTIVE),
    classic=(),
    sheared=True,
)
