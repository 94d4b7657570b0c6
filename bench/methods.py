"""Speed and errors of the classic and the projection method in the deep pool; pressure solvers."""

import statistics
import time
from functools import partial

import numpy as np
import taichi as ti

from bench import tanks
from bench.tables import Bench, Table
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
# Simulated time of each run [s].
SECONDS = 4.0
# Formats of the figures by their head in the tables.
SPEEDS = {
    "particles": ",.0f",
    "ms per frame": ".1f",
    "real-time factor": ".2f",
    "steps per frame": ".1f",
    "momentum drift": ".2%",
    "energy gain": ".2%",
}
ERRORS = {
    "pressure error, rms over depth": ".1%",
    "bulk density error": "+.2%",
    "kernel density error, mean": ".2%",
    "99th percentile of it": ".2%",
    "solver residual, mean": ".3%",
    "99th percentile": ".2%",
    "largest": ".1%",
    "height of the centre of mass": "+.2%",
    "energy rise in 1 s": ".3%",
    "kinetic energy, J": ".2f",
}
SOLVES = {
    "remaining error": ".1%",
    "conjugate gradients: iterations": ".0f",
    "ms": ".1f",
    "Jacobi: iterations": ".0f",
    "Jacobi: ms": ".1f",
    "Jacobi: remaining error": ".1%",
}
# Limit of the launches of the Jacobi solver, and iterations per launch.
MAX_LAUNCHES, PER_LAUNCH = 150, 4


def speed(setup: str, start: int) -> dict[str, float]:
    """Returns the speed of the rocking pool, simulation only."""
    scene = load_scene(SCENE, (*GIVEN, *SETUPS[setup], f"seed={start}"))
    found = benchmark(scene, SCENE, SECONDS, render=False)
    return {
        "particles": sum(found.particles),
        "ms per frame": found.frame_p50_ms,
        "real-time factor": found.simulated_per_wall,
        "steps per frame": found.steps_per_frame,
        "momentum drift": found.momentum_drift,
        "energy gain": found.energy_gain,
    }


def errors(setup: str, start: int) -> dict[str, float]:
    """Returns the errors of the still pool over the second half of the run."""
    scene = load_scene(SCENE, (*GIVEN, *SETUPS[setup], "sway.angle=0", f"seed={start}"))
    sim = build_simulation(scene)
    reading = tanks.Reading(sim)
    tanks.run(sim, 0.5 * SECONDS)
    reading.read()
    tanks.run(sim, 0.5 * SECONDS, reading)
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


TABLES = {
    "speed": Table(
        f"Speed and errors of `{SCENE}`, rocking, simulation only",
        ("method",),
        {(setup,): partial(speed, setup) for setup in SETUPS},
        SPEEDS,
    ),
    "errors": Table(
        f"Errors of `{SCENE}` at rest, over the second half of {SECONDS:g} s",
        ("method",),
        {(setup,): partial(errors, setup) for setup in SETUPS},
        ERRORS,
    ),
    "solve": Table(
        "Pressure solve of one step in still water 60 spacings deep: conjugate gradients to the "
        "default tolerance, Jacobi until its displacements have the same error",
        ("water", "initial guess"),
        {
            (water, guess): partial(solve, layers, guess == "warm")
            for water, layers in (("uniform", 1), ("layered", 4))
            for guess in ("cold", "warm")
        },
        SOLVES,
    ),
}
BENCHES = {
    "methods": Bench(
        "Classic and projection method in the deep pool",
        "Medians (least to largest) over the starts.\n",
        TABLES,
    )
}
