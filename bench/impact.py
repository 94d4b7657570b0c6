"""Convergence of the pressures of a dam break on the far wall.

Incompressible water stops within a time step, so the pressure in a single step is an impulse over
the length of the step: it grows with shorter steps and falls with the spacing. The impulse
converges, and so does the mean pressure over a time in which several layers of particles arrive.
Sensors read 0 while they are dry.
"""

from functools import partial

import numpy as np

from bench import tanks
from bench.tables import Bench, Table
from msph.measure.probes import PressureProbe
from msph.measure.snapshot import Snapshot
from msph.scene import load_scene
from msph.scene.schema import Scene

# Factors of the scene's spacings (-), and times between readings [s], which limit the time steps.
RUNS = ((1.26, 0.004), (1.0, 0.004), (0.8, 0.004), (0.63, 0.004), (1.0, 0.002), (1.0, 0.001))
# Simulated time [s]: until the water has climbed the far wall.
SECONDS = 1.1
# Heights of the centres of the sensors, and their edge [m]; averaging times [s].
HEIGHTS, EDGE = (0.03, 0.1, 0.2), 0.05
WINDOWS = (0.01, 0.05)


def sensors(scene: Scene) -> list[PressureProbe]:
    """Returns sensors on the far wall, one for each height."""
    wall, _, middle = np.array(scene.box.size) / 2.0 * (2.0, 1.0, 1.0)
    return [
        PressureProbe(
            f"{height} m",
            (wall, height - EDGE / 2.0, middle - EDGE / 2.0),
            (wall, height + EDGE / 2.0, middle + EDGE / 2.0),
        )
        for height in HEIGHTS
    ]


def highest_mean(readings: np.ndarray, every: float, window: float) -> float:
    """Returns the highest mean [Pa] over any `window` [s] of readings [Pa] at intervals of `every`
    [s], each of which holds since the one before."""
    impulse = np.append(0.0, readings.cumsum() * every)
    ends = every * np.arange(len(impulse))
    begins = np.maximum(ends - window, 0.0)
    return float((impulse - np.interp(begins, ends, impulse)).max() / window)


def run(factor: float, every: float, seed: int) -> list[dict[str, str | float]]:
    """Returns a row for each height: highest reading and highest mean for each averaging time
    [kPa], and impulse [kPa s]."""
    scene = load_scene("dam_break", (f"seed={seed}",))
    layers = [s.model_copy(update={"spacing": factor * s.spacing}) for s in scene.layers]
    sim = tanks.build(scene.model_copy(update={"layers": layers}))
    particles, readings = sim.particles.count, []
    probes = sensors(scene)

    def record() -> None:
        water = Snapshot.of(sim)
        readings.append([probe.read(water)[0] for probe in probes])

    tanks.recorded(sim, SECONDS, read=record, frame=every)
    read = 1e-3 * np.nan_to_num(np.array(readings))
    return [
        {
            "height of the sensor, m": f"{height}",
            "particles": particles,
            "steps": sim.steps,
            "highest reading, kPa": float(read[:, k].max()),
            **{mean_over(w): highest_mean(read[:, k], every, w) for w in WINDOWS},
            "impulse, kPa s": float(read[:, k].sum() * every),
        }
        for k, height in enumerate(HEIGHTS)
    ]


def mean_over(window: float) -> str:
    """Returns the name of the highest mean over `window` [s]."""
    return f"highest mean over {1e3 * window:g} ms, kPa"


SPACING = load_scene("dam_break").layers[0].spacing
BENCHES = {
    "impact": Bench(
        "Pressures of an impact",
        "",
        {
            "impact": Table(
                f"`dam_break`, {SECONDS} s; sensors of {EDGE} x {EDGE} m on the far wall",
                ("spacing, mm", "time between readings, ms"),
                {
                    (f"{1e3 * factor * SPACING:.1f}", f"{1e3 * every:g}"): partial(
                        run, factor, every
                    )
                    for factor, every in RUNS
                },
                {
                    "particles": ",.0f",
                    "steps": ".0f",
                    "highest reading, kPa": ".1f",
                    **{mean_over(w): ".1f" for w in WINDOWS},
                    "impulse, kPa s": ".2f",
                },
                starts=1,
            )
        },
    )
}
