"""Tanks of uniform or layered water for benchmarks, and measurements on them."""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import taichi as ti

from bench.water import GRAVITY, Water, water_of
from msph.fluid.external_forces import ExternalForces
from msph.fluid.moving_box import MovingBox
from msph.fluid.simulation import Simulation
from msph.measure.ledger import Ledger
from msph.scene.build import build_simulation
from msph.scene.schema import Scene

# Modes of the series of a duct along each axis: the flow is exact to 1e-5.
DUCT_MODES = 40
# Heights of a duct's column of water at the start, and of the duct, in edges.
DUCT_WATER, DUCT_TOP = (3.0, 6.5), 7.0
FRAME = 1.0 / 60.0
STILL = ExternalForces((0.0, -GRAVITY, 0.0))
# Number of horizontal slices of a depth profile, and positions of the probes in each slice, (x, z)
# over the footprint.
SLICES = 12
COLUMNS = ((0.25, 0.25), (0.25, 0.75), (0.75, 0.25), (0.75, 0.75))


def scene(
    size: Sequence[float],
    finest: float,
    layers: int,
    water: list[dict[str, Any]],
    ratio: float = 2.0,
    smoothing: float | None = None,
    adaptation: dict[str, Any] | None = None,
    **sections: Any,
) -> Scene:
    """Returns the scene of a box of `size` [m] with volumes of water as in a scene file.

    layers: 1 for uniform particles of `finest` spacing [m]; otherwise the number of adaptive
    layers, each of `ratio` times the mass of the next finer; the water is filled with the coarsest.
    smoothing: support over spacing, None: default. adaptation: changed parameters of the section;
    sections: other parts of the scene.
    """
    masses = [1000.0 * finest**3 * ratio**k for k in range(layers)]
    return Scene.model_validate(
        {
            "box": {"size": size},
            "layers": [{"mass": mass, "smoothing": smoothing} for mass in masses],
            "water": [{"layer": layers - 1, **volume} for volume in water],
            "adaptation": {"enabled": layers > 1, **(adaptation or {})},
            **sections,
        }
    )


def tank(
    footprint: tuple[float, float],
    depth: float,
    finest: float,
    layers: int,
    air: float = 0.3,
    **more: Any,
) -> Scene:
    """Returns the scene of a box of `footprint` (x, z) [m] with water of `depth` [m] and `air` [m]
    above it; other arguments as for scene()."""
    x, z = footprint
    water = {"lo": [0, 0, 0], "hi": [x, depth, z]}
    return scene([x, depth + air, z], finest, layers, [water], **more)


def duct(edge: float, spacings: int, viscosity: float, layers: int, **more: Any) -> Scene:
    """Returns the scene of a square duct of `edge` [m] without slip, whose water (DUCT_WATER) falls
    from rest.

    spacings: finest spacings across the duct; viscosity [Pa s]; other arguments as for scene().
    """
    bottom, top = (height * edge for height in DUCT_WATER)
    water = {"lo": [0, bottom, 0], "hi": [edge, top, edge]}
    size, terms = [edge, DUCT_TOP * edge, edge], {"viscosity": viscosity, "slip": False}
    return scene(size, edge / spacings, layers, [water], projection=terms, **more)


def duct_speed(x: np.ndarray, z: np.ndarray, edge: float, nu: float, seconds: float) -> np.ndarray:
    """Returns the speed [m/s] at x, z [m] of a liquid that has fallen in a square duct for
    `seconds`, from rest: the series of sin(m pi x/edge) sin(n pi z/edge), m and n odd.

    nu: kinematic viscosity [m^2/s].
    """
    wave = np.pi / edge * np.arange(1, DUCT_MODES, 2)
    rate = nu * (wave[:, None] ** 2 + wave**2)
    share = 16.0 / (edge**2 * wave[:, None] * wave) * GRAVITY / rate * -np.expm1(-rate * seconds)
    return np.einsum("im,mn,in->i", np.sin(np.outer(x, wave)), share, np.sin(np.outer(z, wave)))


@dataclass
class Reading:
    """Measurements of the water at each read(): times [s], energies [J], density errors (-)."""

    source: Water | Simulation
    times: list[float] = field(default_factory=list)
    energies: list[float] = field(default_factory=list)
    kinetic: list[float] = field(default_factory=list)
    centres: list[np.ndarray] = field(default_factory=list)
    error_mean: list[float] = field(default_factory=list)
    error_p99: list[float] = field(default_factory=list)
    error_max: list[float] = field(default_factory=list)
    _pressure: np.ndarray = field(default_factory=lambda: np.zeros(SLICES))
    _weight: np.ndarray = field(default_factory=lambda: np.zeros(SLICES))

    def __post_init__(self):
        self.water = water_of(self.source)
        self.depth = self._volume() / (self.water.size[0] * self.water.size[2])

    def read(self) -> None:
        """Adds the current state."""
        # Residuals are read first, because measuring them sorts our particles.
        excess = self.water.residuals()
        m, x, v = self.water.masses(), self.water.positions(), self.water.velocities()
        self.times.append(self.water.time)
        self.kinetic.append(0.5 * float((m * (v**2).sum(axis=1)).sum()))
        self.energies.append(self.kinetic[-1] + GRAVITY * float((m * x[:, 1]).sum()))
        self.centres.append((m[:, None] * x).sum(axis=0) / m.sum())
        self.error_mean.append(float((m * excess).sum() / m.sum()))
        self.error_p99.append(float(np.percentile(excess, 99.0)))
        self.error_max.append(float(excess.max()))
        hydrostatic = 1000.0 * GRAVITY * (self.depth - x[:, 1])
        slice_ = np.clip((x[:, 1] / self.depth * SLICES).astype(int), 0, SLICES - 1)
        pressure = self.water.pressures()
        pressure = np.full(len(x), np.nan) if pressure is None else pressure
        self._pressure += np.bincount(slice_, m * (pressure - hydrostatic), SLICES)
        self._weight += np.bincount(slice_, m, SLICES)

    def pressure_error(self) -> float:
        """Returns the root mean square over depth of the error of the mean pressure, over rho g H.

        Slices are weighted by their mass: between coarse particles some slices are nearly empty.
        """
        mean = self._pressure / np.maximum(self._weight, 1e-9)
        square = np.average(mean**2, weights=self._weight)
        return float(np.sqrt(square) / (1000.0 * GRAVITY * self.depth))

    def energy_rise(self, seconds: float = 1.0) -> float:
        """Returns the largest rise of the energy within `seconds`, over the potential energy
        (-)."""
        return self._rise(seconds) / self._potential()

    def energy_rise_of_motion(self, seconds: float = 1.0) -> float:
        """Returns the largest rise of the energy within `seconds`, over the largest kinetic plus
        available potential energy, above level water (-). The available energy counts only if it is
        positive: coarse water comes to rest below its level."""
        available = max(self.energies) - self._potential()
        return self._rise(seconds) / max(available, *self.kinetic)

    def _rise(self, seconds: float) -> float:
        """Returns the largest rise of the energy within `seconds` [J]."""
        e, n = np.array(self.energies), round(seconds / FRAME)
        rises = [e[k + 1 : k + 1 + n].max() - e[k] for k in range(len(e) - 1)]
        return max(0.0, max(rises))

    def _potential(self) -> float:
        """Returns the potential energy of level water [J]."""
        return 1000.0 * GRAVITY * 0.5 * self.depth * self._volume()

    def volume_error(self) -> float:
        """Returns the height of the centre of mass in the last second over half the depth, minus
        1."""
        heights = np.array(self.centres)[-60:, 1]
        return float(heights.mean() / (0.5 * self.depth) - 1.0)

    def motion(self, seconds: float = 1.0) -> float:
        """Returns the root mean square of the speed over the last `seconds`, over sqrt(g H) (-)."""
        kinetic = np.mean(self.kinetic[-round(seconds / FRAME) :])
        speed = math.sqrt(2.0 * kinetic / (1000.0 * self._volume()))
        return speed / math.sqrt(GRAVITY * self.depth)

    def _volume(self) -> float:
        return float(self.water.masses().sum()) / 1000.0


class Profile:
    """Pressure over depth, measured by probes at the centre of every slice at each read().

    Means over the particles of a slice are inaccurate where particles are larger than the slice.
    """

    def __init__(self, source: Water | Simulation, depth: float):
        self.water = water = water_of(source)
        self.depth, self.frames = depth, 0
        self.heights = (np.arange(SLICES) + 0.5) / SLICES * depth
        x, _, z = water.size
        places = [(a * x, y, b * z) for y in self.heights for a, b in COLUMNS]
        self.points = np.array(places)
        self.sums = np.zeros(SLICES)

    def read(self) -> None:
        """Adds the current state."""
        # The pressure of dry points is 0.
        pressures = np.nan_to_num(self.water.snapshot().pressures(self.points))
        self.sums += pressures.reshape(SLICES, -1).mean(axis=1)
        self.frames += 1

    def error(self) -> float:
        """Returns the root mean square over depth of the error of the mean pressure, over rho g
        H."""
        off = self.sums / self.frames - 1000.0 * GRAVITY * (self.depth - self.heights)
        return float(np.sqrt(np.mean(off**2)) / (1000.0 * GRAVITY * self.depth))


def run(source: Water | Simulation, seconds: float, *readings: Reading | Profile) -> None:
    """Advances the water under gravity and reads all readings after each frame."""
    water = water_of(source)
    for _ in range(round(seconds / FRAME)):
        water.advance(FRAME, GRAVITY)
        for reading in readings:
            reading.read()


def recorded(
    sim: Simulation,
    seconds: float,
    forces: Callable[[float], ExternalForces | MovingBox] = lambda time: STILL,
    read: Callable[[], None] = lambda: None,
    frame: float = FRAME,
    density_every: float = math.inf,
) -> Ledger:
    """Advances a simulation under forces(time), and calls read() after each frame; returns the
    ledger of the run, by default without solver residuals."""
    ledger = Ledger(sim, density_every)
    ledger.record(forces(sim.time).gravity)
    for _ in range(round(seconds / frame)):
        given = forces(sim.time)
        sim.advance(frame, given)
        ledger.record(given.gravity)
        read()
    return ledger


def build(scene: Scene) -> Simulation:
    """Builds the simulation of a scene; forces on bodies are recorded."""
    sim = build_simulation(scene)
    sim.record_forces()
    return sim


def largest_rise(energies: list[float]) -> float:
    """Returns the largest rise of energies over an earlier one."""
    return float((energies - np.minimum.accumulate(energies)).max())


def water_volume(sim: Simulation) -> float:
    """Returns the volume of the water at rest [m^3]."""
    specs = sim.layers.specs
    return sum(n * s.mass / s.density for n, s in zip(sim.counts(), specs, strict=True))


def milliseconds(work: Callable[[], object]) -> float:
    """Returns the elapsed time of work() and the kernels that it launches [ms]."""
    ti.sync()
    begin = time.perf_counter()
    work()
    ti.sync()
    return 1e3 * (time.perf_counter() - begin)


def in_turns(
    works: dict[str, Callable[[], object]], rounds: int, repeats: int = 1
) -> dict[str, list[float]]:
    """Returns the elapsed times of works [ms] by name. The works run in alternating rounds of
    `repeats`; the first round compiles and is not timed."""
    times: dict[str, list[float]] = {name: [] for name in works}
    for turn in range(rounds + 1):
        for name, work in works.items():
            found = [milliseconds(work) for _ in range(repeats)]
            times[name] += found if turn else []
    return times


def slosh(source: Water | Simulation, depth: float, amplitude: float) -> None:
    """Adds the velocities of the first sloshing mode along x at its zero crossing.

    v_x = -a omega sin(kx) cosh(ky)/sinh(kH), v_y = a omega cos(kx) sinh(ky)/sinh(kH), k = pi/L.
    amplitude [m] of the surface. Displaced particles would be less evenly arranged, and the water
    would rise as they rearrange.
    """
    water = water_of(source)
    length = water.size[0]
    k, omega = math.pi / length, 2.0 * math.pi / slosh_period(length, depth)
    x, v = water.positions(), water.velocities()
    kx, ky, scale = k * x[:, 0], k * x[:, 1], amplitude * omega / math.sinh(k * depth)
    v[:, 0] -= scale * np.sin(kx) * np.cosh(ky)
    v[:, 1] += scale * np.cos(kx) * np.sinh(ky)
    water.set_velocities(v)


def slosh_period(length: float, depth: float) -> float:
    """Returns the period [s] of the first mode: omega^2 = g k tanh(k H), k = pi/L."""
    k = math.pi / length
    return 2.0 * math.pi / math.sqrt(GRAVITY * k * math.tanh(k * depth))


def fitted_wave(times: list[float], values: np.ndarray, guess: float) -> tuple[float, float]:
    """Returns the decay rate [1/s] and the period [s] of the damped cosine that fits best."""
    from scipy.optimize import curve_fit

    def wave(t, mean, a, b, rate, period):
        angle = 2.0 * np.pi * t / period
        return mean + np.exp(-rate * t) * (a * np.cos(angle) + b * np.sin(angle))

    start = (values.mean(), 0.0, values.min() - values.mean(), 0.1, guess)
    found, _ = curve_fit(wave, np.array(times), values, p0=start, maxfev=20_000)
    return float(found[3]), float(found[4])
