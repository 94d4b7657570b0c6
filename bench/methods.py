"""Speed and errors of the classic and the projection method in the deep pool; pressure solvers.

python bench/methods.py [--seconds 4] [--rounds 2] [--arch cpu]
"""

import csv
import statistics
import sys
import time
from pathlib import Path

import click
import numpy as np
import taichi as ti
from tabulate import tabulate

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from bench import tanks
from bench.report import RESULTS, heading
from msph.device import ARCHES, start
from msph.fluid.external_forces import ExternalForces
from msph.measure.bulk import bulk_density
from msph.scene import load_scene
from msph.scene.build import build_simulation
from msph.stage.benchmark import benchmark
from msph.taichi_internals import data_oriented, kernel

SCENE = "pool_2x"
# The particles of the thesis, without the shear relief that the scene enables.
GIVEN = ("variant=system-3", "projection.shear_relief=0")
# Compared set-ups, as changes to the scene: both methods on the particles of the thesis, and the
# projection method with seven layers in bands of one or two particles, assigned at the start.
SETUPS = {
    "classic": ("method=classic",),
    "projection": (),
    "projection, thin bands": (
        f"layers=[{', '.join(f'{{mass={0.1 * 2**k:g}}}' for k in range(7))}]",
        "water=[{layer=6, lo=[0, 0, 0], hi=[1, 1.1, 1]}]",
        "adaptation.enabled=true",
        "adaptation.band=0.5",
        f"adaptation.every={10**9}",
    ),
}
# Limit of the launches of the Jacobi solver, and iterations per launch.
MAX_LAUNCHES, PER_LAUNCH = 150, 4


def errors(setup: str, seconds: float) -> dict[str, str]:
    """Returns the table row of the errors of a still pool."""
    scene = load_scene(SCENE, (*GIVEN, *SETUPS[setup], "sway.angle=0"))
    sim = build_simulation(scene)
    reading = tanks.Reading(sim)
    tanks.run(sim, 0.5 * seconds)
    reading.read()
    tanks.run(sim, 0.5 * seconds, reading)
    spacing = np.array([s.spacing for s in sim.layers.specs])[sim.particles.numpy("layer")]
    bulk = bulk_density(sim.particles.numpy("x"), spacing, sim.size, sim.boundary.free)
    return {
        "method": setup,
        "pressure error, rms over depth": f"{100 * reading.pressure_error():.1f} %",
        "bulk density error": f"{100 * (bulk.mean - 1.0):+.2f} %",
        "solver residual, mean": f"{100 * np.mean(reading.error_mean):.3f} %",
        "99th percentile": f"{100 * np.mean(reading.error_p99):.2f} %",
        "largest": f"{100 * max(reading.error_max):.1f} %",
        "height of the centre of mass": f"{100 * reading.volume_error():+.2f} %",
        "energy rise in 1 s": f"{100 * reading.energy_rise():.3f} %",
        "kinetic energy, J": f"{reading.kinetic[-1]:.2f}",
    }


@data_oriented
class Jacobi:
    """Pressure solver by under-relaxed Jacobi iterations, as in DFSPH, on a solver's right-hand
    side and operator."""

    def __init__(self, solver):
        self.particles, self.operator = solver.particles, solver.pressure_solve.operator
        self.correction = solver.position_correction

    def run(self, launches: int) -> int:
        """Runs PER_LAUNCH iterations per launch; returns the number of iterations."""
        for _ in range(launches):
            self._relax(self.particles.count)
        return PER_LAUNCH * launches

    @kernel
    def _relax(self, n: ti.i32):
        p = self.particles
        for _ in ti.static(range(PER_LAUNCH)):
            self.operator.apply(n, p.velocity_multiplier)
            for i in range(n):
                r = p.rhs[i] + self.operator.divergence(i, p.displacement)
                p.velocity_multiplier[i] = self.correction.relaxed(i, p.velocity_multiplier[i], r)

    @kernel
    def displace(self, n: ti.i32):
        """Computes the displacements by the velocity multipliers."""
        self.operator.apply(n, self.particles.velocity_multiplier)


def solvers(layers: int, depth: int) -> list[dict[str, str]]:
    """Compares conjugate gradients and Jacobi in one step of still water, with the initial guess 0
    (cold) and with the pressures of the step before (warm); returns two table rows.

    The error is the difference of the displacements from a solve of 2,000 iterations, weighted by
    volume.
    """
    fine = 0.02
    sim = tanks.build(tanks.tank((10 * fine, 10 * fine), depth * fine, fine, layers))
    tanks.run(sim, 0.5)
    solver, p, n = sim.solver, sim.particles, sim.particles.count
    dt = solver.longest_step()
    volume = np.array([s.volume for s in sim.layers.specs])[p.numpy("layer")]
    solver.measure_density()
    solver.position_correction.find(dt)
    for force in solver.forces:
        force.apply(dt, ExternalForces(gravity=(0.0, -tanks.GRAVITY, 0.0)))
    solve_for = solver.pressure_solve
    solve_for.build_rhs(n, dt)
    warm = p.velocity_multiplier.to_numpy()
    jacobi = Jacobi(solver)

    def solve(start, run):
        p.velocity_multiplier.from_numpy(start)
        ti.sync()
        begin = time.perf_counter()
        iterations = run()
        jacobi.displace(n)
        ti.sync()
        wall = 1e3 * (time.perf_counter() - begin)
        return iterations, wall, p.numpy("displacement").astype(float)

    def distance(u, true):
        scale = (volume * (true**2).sum(axis=1)).sum()
        return float(np.sqrt((volume * ((u - true) ** 2).sum(axis=1)).sum() / scale))

    limits = solver.parameters
    _, _, true = solve(warm, lambda: solve_for.solve_to(dt, 1e-9, 0.0, 2000))
    motion_weight = limits.motion_tolerance / limits.tolerance
    rows = []
    for name, begin in (("cold", 0.0 * warm), ("warm", warm)):
        cg = [
            solve(
                begin,
                lambda: solve_for.solve_to(dt, limits.tolerance, motion_weight, 500),
            )
            for _ in range(5)
        ]
        error = distance(cg[0][2], true)
        count = 1
        while (
            count < MAX_LAUNCHES
            and distance(solve(begin, lambda c=count: jacobi.run(c))[2], true) > error
        ):
            count = min(MAX_LAUNCHES, int(1.25 * count) + 1)
        walls = [solve(begin, lambda c=count: jacobi.run(c))[1] for _ in range(5)]
        reached = distance(solve(begin, lambda c=count: jacobi.run(c))[2], true)
        rows.append(
            {
                "water": f"{'layered' if layers > 1 else 'uniform'}, {depth} spacings deep",
                "initial guess": name,
                "remaining error": f"{100 * error:.1f} %",
                "conjugate gradients": f"{cg[0][0]} iterations, "
                f"{statistics.median(c[1] for c in cg):.1f} ms",
                "Jacobi": f"{PER_LAUNCH * count} iterations, {statistics.median(walls):.1f} ms"
                + ("" if reached <= error else f", remaining error {100 * reached:.1f} %"),
            }
        )
    return rows


@click.command()
@click.option("--seconds", default=4.0, show_default=True, help="Simulated time of each run [s].")
@click.option(
    "--rounds",
    default=2,
    show_default=True,
    type=click.IntRange(min=1),
    help="Number of runs of each set-up.",
)
@click.option("--arch", type=click.Choice(ARCHES), default="auto", show_default=True)
def main(seconds: float, rounds: int, arch: str) -> None:
    """Measure speed and errors, and write bench/results/methods.{md,csv}."""
    arch = start(arch)
    speeds = []
    for _ in range(rounds):
        for setup, changes in SETUPS.items():
            scene = load_scene(SCENE, (*GIVEN, *changes))
            name = f"{SCENE}, rocking, {setup}"
            speeds.append(benchmark(scene, name, seconds, render=False).row())
    found = [errors(setup, seconds) for setup in SETUPS]
    compared = [row for layers in (1, 4) for row in solvers(layers, 60)]
    RESULTS.mkdir(exist_ok=True)
    with open(RESULTS / "methods.csv", "w", newline="") as file:
        writer = csv.DictWriter(file, found[0].keys())
        writer.writeheader()
        writer.writerows(found)
    report = [heading("Classic and projection method in the deep pool", arch)]
    report.append("Speed and errors, simulation only:\n")
    report.append(tabulate(speeds, headers="keys", tablefmt="github", disable_numparse=True))
    report.append(f"\nErrors of the pool at rest, over the second half of {seconds:g} s:\n")
    report.append(tabulate(found, headers="keys", tablefmt="github", disable_numparse=True))
    report.append(
        "\nPressure solve of one step in still water: conjugate gradients to the default "
        "tolerance, Jacobi until\nits displacements have the same error:\n"
    )
    report.append(tabulate(compared, headers="keys", tablefmt="github", disable_numparse=True))
    (RESULTS / "methods.md").write_text("\n".join([*report, ""]))
    click.echo("\n".join(report))


if __name__ == "__main__":
    main()
