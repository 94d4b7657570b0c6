"""Moving tanks and wave makers against theory.

Surge at the first sloshing period, steady rotation, free fall, wave makers, and the rolled tank of
SPHERIC test 10. Heights and motions are computed from positions and velocities.
"""

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from bench import rows, tanks
from bench.tables import Bench, Table
from msph.fluid.moving_box import MovingBox
from msph.fluid.simulation import Simulation
from msph.measure.ledger import Ledger
from msph.measure.probes import HeightProbe, PressureProbe
from msph.measure.snapshot import Snapshot
from msph.scene.motion import box_path
from msph.scene.schema import Scene
from msph.scene.wavemakers import group_speed, wave_number

G = tanks.GRAVITY
# Depth in spacings, and spacing [m], of the surged tank and of the wave tank.
ACROSS, SPACING = 12, 0.0125
# Surged tank: length [m], amplitude of the surge over the length, number of modes of the theory.
LENGTH, SURGE, MODES = 0.6, 0.003, 30
# Rotating tank: edge, depth, rise of the surface at the middle of the walls, finest spacing [m];
# time [s] in which the water comes to rest, the last second of which is measured.
EDGE, DEPTH, RISE, FINE, REST = 0.4, 0.16, 0.12, 0.0125, 7.0
# Waves: height over depth by kd (higher long waves are not linear, and lower waves are less than a
# spacing high); length of the beach and distance of two gauges over the wavelength; number of
# periods after the arrival at the gauges, and number of the last periods that are measured.
HEIGHTS = {0.5: 0.08, 1.0: 0.12, 2.0: 0.12}
BEACH, APART, PERIODS, MEASURED = 1.5, 0.25, 6, 3
# SPHERIC test 10: tank, depth [m], angle [deg], first period [s], share of it at which the tank is
# driven, and averaging time [s] of the sensor, 1 cm wide at the level of the water.
ROLLED, FILL, ANGLE, FIRST, SHARE = (0.9, 0.508, 0.062), 0.093, 4.0, 1.919, 0.85
WINDOW, ROUNDS = 0.01, 10

Read = Callable[[Simulation], None]


def run(scene: Scene, seconds: float, read: Read, frame: float = tanks.FRAME) -> Ledger:
    """Runs a scene with its motions, and read() after each frame; returns the ledger."""
    sim = tanks.build(scene)
    box = partial(MovingBox, scene.gravity, box_path(scene))
    return tanks.recorded(sim, seconds, box, lambda: read(sim), frame)


def surge_theory(times: np.ndarray, amplitude: float, depth: float) -> np.ndarray:
    """Returns the displacement [m] of the centre of mass relative to a tank that is displaced by
    amplitude sin(omega t), omega of the first mode, by linear theory: mode n obeys
    b'' + omega_n^2 b = -(4/L) tanh(k H)/k X'', and displaces the centre by -2 b/(k^2 L H)."""
    omega, total = 2.0 * math.pi / tanks.slosh_period(LENGTH, depth), np.zeros_like(times)
    for n in range(1, 2 * MODES, 2):
        k = n * math.pi / LENGTH
        own = math.sqrt(G * k * math.tanh(k * depth))
        push = 4.0 / LENGTH * math.tanh(k * depth) / k * amplitude * omega**2
        if n == 1:
            b = push * (np.sin(omega * times) / omega - times * np.cos(omega * times)) / 2.0 / omega
        else:
            b = push * (np.sin(omega * times) - omega / own * np.sin(own * times))
            b /= own**2 - omega**2
        total += 2.0 * b / (k**2 * LENGTH * depth)
    return total


def surge(layers: int, seed: int) -> dict[str, float]:
    """Returns the figures of a tank surged at its first sloshing period: amplitudes of the
    centre's displacement in each of three periods against linear theory."""
    depth, amplitude = ACROSS * SPACING, SURGE * LENGTH
    period = tanks.slosh_period(LENGTH, depth)
    motion = {"displacement": [f"{amplitude} * sin(2*pi*t/{period})", 0, 0]}
    footprint = LENGTH, 4 * SPACING
    scene = tanks.tank(footprint, depth, SPACING, layers, seed=seed, motion=motion)
    ledger = run(scene, 3.02 * period, lambda sim: None)
    t = np.array([e.time for e in ledger.entries])
    x = np.array([e.centre[0] for e in ledger.entries]) - 0.5 * LENGTH
    theory, found = surge_theory(t, amplitude, depth), {}
    for n in range(3):
        during = (t > n * period) & (t <= (n + 1) * period)
        found[f"period {n + 1}"] = np.ptp(x[during]) / np.ptp(theory[during]) - 1.0
    return {**found, "energy gain": ledger.energy_gain()}


def rotating(layers: int, seed: int) -> dict[str, float]:
    """Returns the figures of water in a tank that rotates about the vertical: the paraboloid's
    rise against omega^2 r^2/(2 g), the pressure against hydrostatics below it, and the motion."""
    omega = 2.0 * math.sqrt(2.0 * G * RISE) / EDGE
    radii = np.linspace(0.0, 0.85, 7)[:, None] * 0.5 * EDGE
    angles = np.arange(8) * math.pi / 4.0
    places = np.stack([radii * np.cos(angles), radii * np.sin(angles)], axis=-1).reshape(-1, 2)
    scene = tanks.tank(
        (EDGE, EDGE),
        DEPTH,
        FINE,
        layers,
        air=0.2,
        seed=seed,
        motion={"angle": f"{math.degrees(omega)} * t", "axis": [0, 1, 0]},
        projection={"shear_relief": 0.0},  # numerical friction brings the water to rest
    )
    probes = [HeightProbe("", tuple(place)) for place in places + 0.5 * EDGE]
    heights: list[list[float]] = []
    last: list[np.ndarray] = []

    def read(sim: Simulation) -> None:
        last[:] = [sim.particles.numpy(k).astype(float) for k in ("x", "pressure")]
        if sim.time > REST - 1.0:
            water = Snapshot.of(sim)
            heights.append([p.read(water)[0] for p in probes])

    ledger = run(scene, REST, read)
    r2 = (places**2).sum(axis=1)
    slope = np.polyfit(r2, np.mean(heights, axis=0), 1)[0]
    x, p = last
    level = DEPTH - omega**2 / (2.0 * G) * EDGE**2 / 6.0
    square = (x[:, 0] - 0.5 * EDGE) ** 2 + (x[:, 2] - 0.5 * EDGE) ** 2
    expected = 1000.0 * G * (level + omega**2 / (2.0 * G) * square - x[:, 1])
    deep = expected > 1000.0 * G * 3.0 * FINE
    error = np.sqrt(np.mean((p - expected)[deep] ** 2)) / (1000.0 * G * DEPTH)
    speed = math.sqrt(2.0 * ledger.rest_energy() / ledger.entries[-1].mass)
    return {
        "rise of the surface": slope * 2.0 * G / omega**2 - 1.0,
        "pressure": error,
        "speed [m/s]": speed,
        "energy gain": ledger.energy_gain(),
    }


def free_fall(layers: int, seed: int) -> dict[str, float]:
    """Returns the figures of a tank that falls freely after 1 s of rest: the pressure over
    rho g H, and the speed of the water relative to the tank, before and after."""
    fall = {"displacement": [0, f"-{0.5 * G} * max(t - 1, 0)**2", 0]}
    scene = tanks.tank((EDGE, EDGE), DEPTH, 2.0 * FINE, layers, seed=seed, motion=fall)
    seen = []

    def read(sim: Simulation) -> None:
        p, v = (sim.particles.numpy(k).astype(float) for k in ("pressure", "v"))
        pressure = np.abs(p).mean() / (1000.0 * G * DEPTH)
        seen.append((sim.time, pressure, math.sqrt((v**2).sum(axis=1).mean())))

    ledger = run(scene, 2.0, read)
    before = np.mean([s[1:] for s in seen if 0.9 < s[0] <= 1.0], axis=0)
    after = np.mean([s[1:] for s in seen if s[0] > 1.1], axis=0)
    return {
        "pressure at rest": before[0],
        "pressure in fall": after[0],
        "speed at rest [m/s]": before[1],
        "speed in fall [m/s]": after[1],
        "energy gain": ledger.energy_gain(),
    }


def height_over_stroke(kind: str, kd: float) -> float:
    """Returns the height of the waves far from a wave maker over its stroke, by linear theory."""
    s, c = math.sinh(kd), math.cosh(kd)
    whole = math.sinh(2.0 * kd) + 2.0 * kd
    if kind == "piston":
        return 2.0 * (math.cosh(2.0 * kd) - 1.0) / whole
    return 4.0 * s * (kd * s - c + 1.0) / (kd * whole)


def waves(kind: str, kd: float, seed: int) -> dict[str, float]:
    """Returns the figures of a wave maker: height over stroke of the first harmonic of the waves
    towards the beach, separated from reflected ones by two gauges, the first of them two depths
    from the maker, and the reflected share of the height."""
    depth = ACROSS * SPACING
    k = kd / depth
    period, length = 2.0 * math.pi / math.sqrt(G * k * math.tanh(kd)), 2.0 * math.pi / k
    theory = height_over_stroke(kind, kd)
    stroke, beach = HEIGHTS[kd] * depth / theory, BEACH * length
    face = 0.5 * (stroke + 2.45 * SPACING)
    places = face + 2.0 * depth + np.array([0.0, APART]) * length
    box = math.ceil((places[1] + depth + beach) / SPACING) * SPACING
    maker = {"kind": kind, "stroke": stroke, "period": period, "ramp": period, "beach": beach}
    footprint = box, 5 * SPACING
    scene = tanks.tank(footprint, depth, SPACING, 1, 0.5 * depth, seed=seed, wavemakers=[maker])
    probes, seen = [HeightProbe("", (x, 2.5 * SPACING)) for x in places], []

    def read(sim: Simulation) -> None:
        water = Snapshot.of(sim)
        seen.append((sim.time, *(p.read(water)[0] for p in probes)))

    travel = (places[1] - face) / group_speed(scene, scene.wavemakers[0])
    seconds = period + travel + PERIODS * period
    ledger = run(scene, seconds, read, period / 48.0)
    t, *heights = np.array([s for s in seen if s[0] > seconds - MEASURED * period]).T
    angle = 2.0 * np.pi * t / period
    parts = [np.ones_like(t), *(f(n * angle) for n in (1, 2) for f in (np.cos, np.sin))]
    fits = [np.linalg.lstsq(np.stack(parts, axis=1), h, rcond=None)[0] for h in heights]
    # eta = Re (a exp(-i omega t)), with a = towards exp(i k x) + back exp(-i k x).
    measured = wave_number(period, depth, G)
    matrix = np.exp(1j * measured * places[:, None] * np.array([1.0, -1.0]))
    towards, back = np.linalg.solve(matrix, [f[1] + 1j * f[2] for f in fits])
    ratio = 2.0 * abs(towards) / stroke
    return {
        "height over stroke": ratio,
        "error": ratio / theory - 1.0,
        "first gauge alone": 2.0 * math.hypot(*fits[0][1:3]) / stroke / theory - 1.0,
        "reflected": abs(back / towards),
        "leaked": float(max(e.outside for e in ledger.entries)),
    }


def rolled(seed: int) -> dict[str, Any]:
    """Returns the figures of the rolled tank: time between impacts on the wall, their phase in
    the period of the roll, and peak pressures over ten periods after the first two."""
    period, spacing = SHARE * FIRST, FILL / ACROSS
    air, footprint = ROLLED[1] - FILL, (ROLLED[0], ROLLED[2])
    angle = f"{ANGLE} * sin(2*pi*t/{period}) * min(t/{period}, 1)"
    roll = {"angle": angle, "centre": [0.5 * ROLLED[0], 0, 0.5 * ROLLED[2]]}
    scene = tanks.tank(footprint, FILL, spacing, 1, air, seed=seed, motion=roll)
    lo, hi = (0, FILL - 0.005, 0.5 * ROLLED[2] - 0.005), (0, FILL + 0.005, 0.5 * ROLLED[2] + 0.005)
    probe, seen = PressureProbe("", lo, hi, WINDOW), []
    ledger = run(
        scene,
        (ROUNDS + 2) * period,
        lambda sim: seen.append((sim.time, probe.read(Snapshot.of(sim))[0])),
        0.5 * WINDOW,
    )
    t, p = np.nan_to_num(np.array(seen)).T
    peaks, arrivals = [], []
    for n in range(2, ROUNDS + 2):
        inside = np.flatnonzero((t > n * period) & (t <= (n + 1) * period))
        top = inside[p[inside].argmax()]
        peaks.append(float(p[top]))
        arrivals.append(float(t[top]))
    phases = [a / period % 1.0 for a in arrivals]
    return {
        "period of the roll [s]": f"{period:.3f}",
        "time between peaks [s]": rows.spread(np.diff(arrivals).tolist(), ".3f"),
        "phase of the peak": rows.spread(phases, ".3f"),
        "peak pressure [Pa]": rows.spread(peaks, ".0f"),
        "peak over rho g H": rows.spread([q / (1000.0 * G * FILL) for q in peaks], ".2f"),
        "energy gain": ledger.energy_gain(),
        "leaked": float(max(e.outside for e in ledger.entries)),
    }


WATERS = (1, 2)
STARTS = f"medians of {rows.STARTS} starts, and their range"
BENCHES = {
    "moving": Bench(
        "Moving tanks and wave makers",
        "",
        {
            "surge": Table(
                f"Tank of {LENGTH} m surged by {SURGE} lengths at its first sloshing period, water "
                f"{ACROSS} spacings deep: amplitude of the centre of mass against linear theory in "
                f"each period; {STARTS}",
                ("layers",),
                {(str(layers),): partial(surge, layers) for layers in WATERS},
                {**{f"period {n}": "+.1%" for n in (1, 2, 3)}, "energy gain": ".0e"},
            ),
            "fall": Table(
                "Free fall after 1 s of rest: mean pressure over rho g H, and speed of the water; "
                f"{STARTS}",
                ("layers",),
                {(str(layers),): partial(free_fall, layers) for layers in WATERS},
                {
                    "pressure at rest": ".3f",
                    "pressure in fall": ".5f",
                    "speed at rest [m/s]": ".4f",
                    "speed in fall [m/s]": ".4f",
                    "energy gain": ".0e",
                },
            ),
            "rotation": Table(
                f"Tank of {EDGE} m rotating about the vertical, surface {RISE} m higher at the "
                "walls: errors of the rise, of the pressure over rho g H, and remaining speed; "
                f"{STARTS}",
                ("layers",),
                {("2",): partial(rotating, 2)},
                {
                    "rise of the surface": "+.1%",
                    "pressure": ".1%",
                    "speed [m/s]": ".3f",
                    "energy gain": ".0e",
                },
            ),
            "waves": Table(
                f"Wave makers, water {ACROSS} spacings deep: height over stroke at two depths from "
                f"the maker; {STARTS}",
                ("maker", "kd", "theory"),
                {
                    (kind, f"{kd:g}", f"{height_over_stroke(kind, kd):.3f}"): partial(
                        waves, kind, kd
                    )
                    for kind in ("piston", "flap")
                    for kd in HEIGHTS
                },
                {
                    "height over stroke": ".3f",
                    "error": "+.1%",
                    "first gauge alone": "+.1%",
                    "reflected": ".1%",
                    "leaked": ".0f",
                },
            ),
            "roll": Table(
                f"SPHERIC test 10: tank of {ROLLED} m rolled by {ANGLE:g} degrees, water {FILL} m "
                f"deep, {ACROSS} spacings, one start; peak of each of {ROUNDS} periods, mean over "
                f"1 cm x 1 cm at the water level and {1e3 * WINDOW:g} ms: median and range",
                (),
                {(): rolled},
                {"energy gain": ".0e", "leaked": ".0f"},
                starts=1,
            ),
        },
    )
}
