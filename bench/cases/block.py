"""A block of about 1 m^3 collapses in a long tank: density errors, without a formula to compare."""

import numpy as np

from bench.cases.case import ADAPTIVE, UNIFORM, Case, Run, Setting, begin, scene
from msph.measure.bulk import KERNEL_RADIUS, bulk_density
from msph.scene.quality import LADDER
from msph.scene.schema import Scene

# Inner edges of the tank along x and y [m]; along z the tank is as wide as the block.
LENGTH, HEIGHT = 3.0, 2.0
# Particles along the edges of the block, by their number per metre.
COUNTS = {14: (14, 14, 13), 17: (17, 17, 17), 27: (27, 27, 27)}
# Simulated time, and time from which densities are measured [s]: before, the block is a lattice.
SECONDS, FROM = 2.0, 0.1
# Time steps and tolerance of the qualities small and medium, at about the compression of DFSPH.
LOOSER = {"cfl": LADDER["medium"].cfl, "motion_tolerance": LADDER["medium"].motion_tolerance}


def tank(setting: Setting) -> Scene:
    """Returns the scene of the block in its tank."""
    spacing = 1.0 / setting.resolution
    high = [n * spacing for n in COUNTS[setting.resolution]]
    water = [{"lo": [0, 0, 0], "hi": high}]
    return scene(setting, (LENGTH, HEIGHT, high[2]), spacing, water)


def measure(setting: Setting) -> tuple[Run, dict[str, float]]:
    """Runs the case; returns the run and its errors."""
    run, bulk = begin(setting, tank(setting)), []

    def read() -> None:
        if run.simulated >= FROM:
            bulk.append(inner_bulk(run.water.positions(), run.water.spacings(), run.water.size))

    run.go(SECONDS, read)
    known = [b - 1.0 for b in bulk if np.isfinite(b)]
    return run, {
        "kernel_density": run.costs()["kernel_density_error_mean"],
        **({"bulk_density": abs(float(np.mean(known)))} if known else {}),
    }


def inner_bulk(x: np.ndarray, spacing: np.ndarray, size: tuple[float, float, float]) -> float:
    """Returns the mean bulk density (-) away from surface and walls of particles at x (n, 3) [m]
    with the spacings (n,) [m], each of volume spacing^3.

    Walls count as air: methods keep different distances from walls, and half a spacing of
    difference would change the density by 4 %.
    """
    room = 2.0 * KERNEL_RADIUS * float(spacing.max())
    return bulk_density(x + room, spacing, tuple(length + 2.0 * room for length in size)).mean


CASE = Case(
    "block",
    f"A block of about 1 m^3 collapses in a tank {LENGTH:g} m long",
    "1 m",
    {
        "kernel_density": "mean kernel density error",
        "bulk_density": "mean bulk density away from surface and walls against the rest density",
    },
    tuple(COUNTS),
    measure,
    kinds=(UNIFORM, ADAPTIVE),
    classic=(),
    varied=(LOOSER,),
    peer=("kernel_density", "bulk_density"),
)
