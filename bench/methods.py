"""The classic method and projection side by side on the deep pool, and how projection solves.

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
# The thesis's particles; shear relief, which the scene has on, is off by the method's default.
GIVEN = ("variant=system-3", "projection.shear_relief=0")
# What is compared, by its changes to the scene: both methods on the thesis's particles, and the
# same water in bands of a sheet or two, seven layers, which the start gives each depth.
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
# Launches that Jacobi may take to come as near as conjugate gradients, and iterations in each.
MOST, RELAXED = 150, 4


def errors(setup: str, seconds: float) -> dict[str, str]:
    """What a still pool does in one setup."""
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
        "pressure, rms over depth": f"{100 * reading.pressure_error():.1f} %",
        "bulk density from positions": f"{100 * (bulk.mean - 1.0):+.2f} %",
        "its own density error": f"{100 * np.mean(reading.error_mean):.3f} %",
        "99th percentile": f"{100 * np.mean(reading.error_p99):.2f} %",
        "largest": f"{100 * max(reading.error_max):.1f} %",
        "height of the centre": f"{100 * reading.volume_error():+.2f} %",
        "energy rise in 1 s": f"{100 * reading.energy_rise():.3f} %",
        "kinetic energy, J": f"{reading.kinetic[-1]:.2f}",
    }


@data_oriented
class Jacobi:
    """The velocity solve by under-relaxed Jacobi, as in DFSPH, on a solver's rhs and operator."""

    def __init__(self, solver):
        self.particles, self.operator = solver.particles, solver.pressure_solve.operator
        self.correction = solver.position_correction

    def run(self, launches: int) -> int:
        """RELAXED iterations a launch; returns how many that makes."""
        for _ in range(launches):
            self._relax(self.particles.count)
        return RELAXED * launches

    @kernel
    def _relax(self, n: ti.i32):
        p = self.particles
        for _ in ti.static(range(RELAXED)):
            self.operator.apply(n, p.velocity_multiplier)
            for i in range(n):
                r = p.rhs[i] + self.operator.divergence(i, p.displacement)
                p.velocity_multiplier[i] = self.correction.relaxed(i, p.velocity_multiplier[i], r)

    @kernel
    def displace(self, n: ti.i32):
        """Displacements by the velocity multipliers."""
        self.operator.apply(n, self.particles.velocity_multiplier)


def solvers(layers: int, sheets: int) -> list[dict[str, str]]:
    """Conjugate gradients against Jacobi on one step of still water, cold and warm.

    The error is that of the displacements, by volume, against a solve of 2,000 iterations.
    """
    fine = 0.02
    sim = tanks.build(tanks.tank((10 * fine, 10 * fine), sheets * fine, fine, layers))
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
            count < MOST and distance(solve(begin, lambda c=count: jacobi.run(c))[2], true) > error
        ):
            count = min(MOST, int(1.25 * count) + 1)
        walls = [solve(begin, lambda c=count: jacobi.run(c))[1] for _ in range(5)]
        reached = distance(solve(begin, lambda c=count: jacobi.run(c))[2], true)
        rows.append(
            {
                "water": f"{'layered' if layers > 1 else 'uniform'}, {sheets} spacings deep",
                "start": name,
                "error left": f"{100 * error:.1f} %",
                "conjugate gradients": f"{cg[0][0]} iterations, "
                f"{statistics.median(c[1] for c in cg):.1f} ms",
                "Jacobi": f"{RELAXED * count} iterations, {statistics.median(walls):.1f} ms"
                + ("" if reached <= error else f", {100 * reached:.1f} % left"),
            }
        )
    return rows


@click.command()
@click.option("--seconds", default=4.0, show_default=True, help="Simulated time of each run.")
@click.option("--rounds", default=2, show_default=True, type=click.IntRange(min=1))
@click.option("--arch", type=click.Choice(ARCHES), default="auto", show_default=True)
def main(seconds: float, rounds: int, arch: str) -> None:
    """Measure and write bench/results/methods.{md,csv}."""
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
    report = [heading("Classic and projection on the deep pool", arch)]
    report.append("Speed, errors of the same run beside it; fluid alone:\n")
    report.append(tabulate(speeds, headers="keys", tablefmt="github", disable_numparse=True))
    report.append(f"\nErrors of the pool at rest, over the second half of {seconds:g} s:\n")
    report.append(tabulate(found, headers="keys", tablefmt="github", disable_numparse=True))
    report.append(
        "\nThe velocity solve of one step in still water: conjugate gradients at the default "
        "tolerance, Jacobi\nuntil it is as near to the converged displacements:\n"
    )
    report.append(tabulate(compared, headers="keys", tablefmt="github", disable_numparse=True))
    (RESULTS / "methods.md").write_text("\n".join([*report, ""]))
    click.echo("\n".join(report))


if __name__ == "__main__":
    main()
