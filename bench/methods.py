"""Speed and errors of the classic and the projection method in the deep pool; pressure solvers.

python bench/methods.py [--seconds 4] [--starts 3] [--resume] [--arch cpu]

Each part is a process, from several starts, and is written to bench/results/methods.csv when it
ends; --resume continues there.
"""

import json
import statistics
import sys
import time
from collections.abc import Callable
from pathlib import Path

import click
import numpy as np
import taichi as ti
from tabulate import tabulate

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from bench import rows, tanks
from bench.report import RESULTS, heading
from msph.device import ARCHES, start
from msph.fluid.external_forces import ExternalForces
from msph.launches import data_oriented, kernel
from msph.measure.bulk import bulk_density
from msph.measure.kernel_density import kernel_density
from msph.scene import load_scene
from msph.scene.build import build_simulation
from msph.stage.benchmark import benchmark

SCENE = "pool_2x"
# The particles of the thesis.
GIVEN = ("variant=system-3",)
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
# Time limit of a part [s].
MAX_SECONDS = 1800
TABLE = "methods.csv"
# Formats of the figures by their head in the tables.
SPEEDS = {
    "particles": "{:,.0f}",
    "ms per frame": "{:.1f}",
    "real-time factor": "{:.2f}",
    "steps per frame": "{:.1f}",
    "momentum drift": "{:.2%}",
    "energy gain": "{:.2%}",
}
ERRORS = {
    "pressure error, rms over depth": "{:.1%}",
    "bulk density error": "{:+.2%}",
    "kernel density error, mean": "{:.2%}",
    "99th percentile of it": "{:.2%}",
    "solver residual, mean": "{:.3%}",
    "99th percentile": "{:.2%}",
    "largest": "{:.1%}",
    "height of the centre of mass": "{:+.2%}",
    "energy rise in 1 s": "{:.3%}",
    "kinetic energy, J": "{:.2f}",
}
SOLVES = {
    "remaining error": "{:.1%}",
    "conjugate gradients: iterations": "{:.0f}",
    "ms": "{:.1f}",
    "Jacobi: iterations": "{:.0f}",
    "Jacobi: ms": "{:.1f}",
    "Jacobi: remaining error": "{:.1%}",
}
# Limit of the launches of the Jacobi solver, and iterations per launch.
MAX_LAUNCHES, PER_LAUNCH = 150, 4


def speed(setup: str, start: int, seconds: float) -> dict[str, float]:
    """Returns the speed of the rocking pool, simulation only."""
    scene = load_scene(SCENE, (*GIVEN, *SETUPS[setup], f"seed={start}"))
    found = benchmark(scene, SCENE, seconds, render=False)
    return {
        "particles": sum(found.particles),
        "ms per frame": found.frame_p50_ms,
        "real-time factor": found.simulated_per_wall,
        "steps per frame": found.steps_per_frame,
        "momentum drift": found.momentum_drift,
        "energy gain": found.energy_gain,
    }


def errors(setup: str, start: int, seconds: float) -> dict[str, float]:
    """Returns the errors of the still pool over the second half of `seconds` [s]."""
    scene = load_scene(SCENE, (*GIVEN, *SETUPS[setup], "sway.angle=0", f"seed={start}"))
    sim = build_simulation(scene)
    reading = tanks.Reading(sim)
    tanks.run(sim, 0.5 * seconds)
    reading.read()
    tanks.run(sim, 0.5 * seconds, reading)
    water = reading.water
    x, spacing = water.positions(), water.spacings()
    kernel = kernel_density(x, spacing, sim.size)
    return {
        "pressure error, rms over depth": reading.pressure_error(),
        "bulk density error": bulk_density(x, spacing, sim.size, sim.boundary.free).mean - 1.0,
        "kernel density error, mean": kernel.mean,
        "99th percentile of it": kernel.p99,
        "solver residual, mean": float(np.mean(reading.error_mean)),
        "99th percentile": float(np.mean(reading.error_p99)),
        "largest": max(reading.error_max),
        "height of the centre of mass": reading.volume_error(),
        "energy rise in 1 s": reading.energy_rise(),
        "kinetic energy, J": reading.kinetic[-1],
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


def solve(layers: int, warm_start: bool, start: int, depth: int = 60) -> dict[str, float]:
    """Compares conjugate gradients and Jacobi in one step of still water, `depth` spacings deep,
    with the initial guess 0 or with the pressures of the step before (warm_start).

    The error is the difference of the displacements from a solve of 2,000 iterations, weighted by
    volume.
    """
    fine = 0.02
    sim = tanks.build(tanks.tank((10 * fine,) * 2, depth * fine, fine, layers, seed=start))
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
    warm = p.fields["velocity_multiplier"].to_numpy()
    jacobi = Jacobi(solver)

    def run_from(guess, run):
        p.velocity_multiplier.from_numpy(guess)
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
    _, _, true = run_from(warm, lambda: solve_for.solve_to(dt, 1e-9, 0.0, 2000))
    motion_weight = limits.motion_tolerance / limits.tolerance
    begin = warm if warm_start else 0.0 * warm
    cg = [
        run_from(begin, lambda: solve_for.solve_to(dt, limits.tolerance, motion_weight, 500))
        for _ in range(5)
    ]
    error, count = distance(cg[0][2], true), 1
    while (
        count < MAX_LAUNCHES
        and distance(run_from(begin, lambda c=count: jacobi.run(c))[2], true) > error
    ):
        count = min(MAX_LAUNCHES, int(1.25 * count) + 1)
    walls = [run_from(begin, lambda: jacobi.run(count))[1] for _ in range(5)]
    return {
        "remaining error": error,
        "conjugate gradients: iterations": cg[0][0],
        "ms": statistics.median(c[1] for c in cg),
        "Jacobi: iterations": PER_LAUNCH * count,
        "Jacobi: ms": statistics.median(walls),
        "Jacobi: remaining error": distance(run_from(begin, lambda: jacobi.run(count))[2], true),
    }


# Parts: function, and first cells of its rows with its arguments.
PARTS: dict[str, tuple[Callable, dict[tuple[str, str], tuple]]] = {
    "speed": (speed, {(f"{SCENE}, rocking", setup): (setup,) for setup in SETUPS}),
    "errors": (errors, {(SCENE, setup): (setup,) for setup in SETUPS}),
    "solve": (
        solve,
        {
            (f"{water}, 60 spacings deep", guess): (layers, guess == "warm")
            for water, layers in (("uniform", 1), ("layered", 4))
            for guess in ("cold", "warm")
        },
    ),
}


def table(known: list[dict], part: str, heads: tuple[str, str], forms: dict[str, str]) -> str:
    """Returns the Markdown table of a part: median (least to largest) over the starts."""
    lines = []
    for name, kind in PARTS[part][1]:
        own = [r for r in known if (r["part"], r["name"], r["kind"]) == (part, name, kind)]
        if own:
            cells = {h: rows.spread([float(r[h]) for r in own], f) for h, f in forms.items()}
            lines.append({**dict(zip(heads, (name, kind), strict=True)), **cells})
    return tabulate(lines, headers="keys", tablefmt="github", disable_numparse=True)


@click.command()
@click.option("--seconds", default=4.0, show_default=True, help="Simulated time of each run [s].")
@click.option(
    "--starts", default=rows.STARTS, show_default=True, type=click.IntRange(1), help="Starts."
)
@click.option("--resume", is_flag=True, help="Keep the rows of earlier runs.")
@click.option("--arch", type=click.Choice(ARCHES), default="auto", show_default=True)
@click.option("--worker", hidden=True)
def main(seconds: float, starts: int, resume: bool, arch: str, worker: str | None) -> None:
    """Measure speed and errors, and write bench/results/methods.{md,csv}."""
    arch = start(arch)
    if worker:
        part, arguments = json.loads(worker)
        print(json.dumps(PARTS[part][0](*arguments)))
        return
    known: list[dict] = rows.read(RESULTS / TABLE) if resume else []
    done = {(r["part"], r["name"], r["kind"], str(r["start"])) for r in known}
    for seed in range(starts):
        for part, (_, cases) in PARTS.items():
            for (name, kind), arguments in cases.items():
                if (part, name, kind, str(seed)) in done:
                    continue
                more = () if part == "solve" else (seconds,)
                task = (part, (*arguments, seed, *more))
                found = rows.in_process(__file__, task, MAX_SECONDS)
                click.echo(f"{part}, {name}, {kind}, start {seed + 1} {found.get('failure', '')}")
                if "failure" not in found:
                    known.append({"part": part, "name": name, "kind": kind, "start": seed, **found})
                    rows.write(RESULTS / TABLE, known)
    count = len({str(r["start"]) for r in known})
    report = [
        heading("Classic and projection method in the deep pool", arch),
        f"{count} starts: median (least to largest).\n\nSpeed and errors, simulation only:\n",
        table(known, "speed", ("pool", "method"), SPEEDS),
        f"\nErrors of the pool at rest, over the second half of {seconds:g} s:\n",
        table(known, "errors", ("pool", "method"), ERRORS),
        "\nPressure solve of one step in still water: conjugate gradients to the default "
        "tolerance, Jacobi until\nits displacements have the same error:\n",
        table(known, "solve", ("water", "initial guess"), SOLVES),
        "",
    ]
    (RESULTS / "methods.md").write_text("\n".join(report))
    click.echo("\n".join(report))


if __name__ == "__main__":
    main()
