"""Dam break, a column twice as high as wide: Martin and Moyce 1952, and Ritter 1892.

The gate of the experiment released the water late, by T = 0.1 to 0.2. The computed front at T -
GATE is compared with the measured front at T, and heights with the same delay in seconds. The front
is also compared without a shift in time, and so is its mean speed between two places.
"""

import numpy as np

from bench import tanks
from bench.cases.case import UNSHEARED, Case, Run, Setting, begin, scene
from msph.measure.probes import FrontProbe, HeightProbe
from msph.scene.library import assets

# Width a of the column and width of the tank [m]; the tank is 5 a long and 2.5 a high.
A, WIDTH = 0.24, 0.16
SIZE = (5.0 * A, 2.5 * A, WIDTH)
# Delay by the gate, in units of T = t sqrt(2 g/a).
GATE = 0.2
# Places of the front over a between which its mean speed is compared.
BETWEEN = (1.5, 3.5)
# Times T until which front and height are compared: before the water reaches the far wall.
FRONT_UNTIL, HEIGHT_UNTIL = 3.33, 3.3
UNIT_T, UNIT_TAU = np.sqrt(A / (2.0 * tanks.GRAVITY)), np.sqrt(A / tanks.GRAVITY)
# Readings per unit of T, and the time T at which values are compared with finer runs.
PER_UNIT, COMPARED = 20, 2.0


def reference(name: str) -> np.ndarray:
    """Returns the columns of a table of the experiment, (2, n)."""
    path = assets() / "reference" / f"martin_moyce_1952_{name}.csv"
    lines = [line for line in path.read_text().splitlines() if not line.startswith("#")]
    return np.array([line.split(",") for line in lines[1:]], float).T


def measure(setting: Setting) -> tuple[Run, dict[str, float]]:
    """Runs the case; returns the run, its errors and values."""
    body = [{"lo": [0, 0, 0], "hi": [A, 2.0 * A, WIDTH]}]
    spacing = A / setting.resolution
    run = begin(setting, scene(setting, SIZE, spacing, body))
    front, height = FrontProbe("", "+x"), HeightProbe("", (0.5 * spacing, 0.5 * WIDTH))
    times, fronts, heights, energies = [0.0], [A], [2.0 * A], [run.water.energy()]
    centres = [run.water.centre()]

    def read() -> None:
        water = run.water.snapshot()
        times.append(run.water.time)
        fronts.append(front.read(water)[0])
        heights.append(height.read(water)[0])
        energies.append(run.water.energy())
        centres.append(run.water.centre())

    run.go((FRONT_UNTIL + 0.1) * UNIT_T, read, frame=UNIT_T / PER_UNIT)
    t = np.array(times) / UNIT_T
    z, h = np.array(fronts) / A, np.array(heights) / (2.0 * A)
    seen_t, seen_z = reference("front")
    seen_tau, seen_h = reference("height")
    # tau = t sqrt(g/a); the delay is the same time.
    delayed = seen_tau * UNIT_TAU / UNIT_T - GATE
    early = delayed <= HEIGHT_UNTIL
    off_z = np.interp(seen_t - GATE, t, z) / seen_z - 1.0
    off_z_unshifted = np.interp(seen_t, t, z) / seen_z - 1.0
    passed, seen = (np.diff(np.interp(BETWEEN, *of))[0] for of in ((z, t), (seen_z, seen_t)))
    off_h = np.interp(delayed[early], t, h) - seen_h[early]
    at = int(np.argmin(np.abs(t - COMPARED)))
    return run, {
        "front": float(np.sqrt(np.mean(off_z**2))),
        "front_without_shift": float(np.sqrt(np.mean(off_z_unshifted**2))),
        "front_speed": float(abs(seen / passed - 1.0)),
        "height": float(np.sqrt(np.mean(off_h**2))),
        "beyond_ritter": float(max(0.0, np.max(z - 1.0 - 2.0 * t))),
        "energy_rise": tanks.largest_rise(energies) / energies[0],
        "front_at_T_2_over_a": float(z[at]),
        "centre_x_at_T_2_over_a": float(centres[at][0] / A),
        "centre_y_at_T_2_over_a": float(centres[at][1] / A),
    }


CASE = Case(
    "dam_break",
    "Dam break of Martin and Moyce (1952), n^2 = 2",
    "width a of the column",
    {
        "front": f"front Z(T - {GATE:g}) against the experiment, rms of the relative error",
        "front_without_shift": "front Z(T) against the experiment, rms of the relative error",
        "front_speed": f"mean speed of the front from Z = {BETWEEN[0]:g} to {BETWEEN[1]:g}",
        "height": "height of the column at the wall over 2a, the same delay, rms",
        "beyond_ritter": "front beyond Ritter's bound 1 + 2T, over a",
        "energy_rise": "largest rise of the energy, over the energy at the start",
    },
    (6, 9, 12, 18),
    measure,
    classic=("uniform",),
    references=(24,),
    values=("front_at_T_2_over_a", "centre_x_at_T_2_over_a", "centre_y_at_T_2_over_a"),
    varied=(UNSHEARED,),
    summary=("front", "front_speed"),
    note=f"front with a shift in time of T = {GATE:g}",
    peer=("front_speed", "front", "front_without_shift", "height"),
)
