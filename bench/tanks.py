"""Tanks of water that benchmarks fill in two ways, and what they read off them."""

import math
from dataclasses import dataclass, field

import numpy as np

from msph.fluid.external_forces import ExternalForces
from msph.fluid.simulation import Simulation
from msph.measure.snapshot import Snapshot
from msph.scene.build import build_simulation
from msph.scene.schema import Scene

GRAVITY = 9.81
FRAME = 1.0 / 60.0
# Sheets of a depth profile, and where probes stand in each, as shares of the footprint (x, z).
SHEETS = 12
COLUMNS = ((0.25, 0.25), (0.25, 0.75), (0.75, 0.25), (0.75, 0.75))


def tank(
    footprint: tuple[float, float],
    depth: float,
    finest: float,
    layers: int,
    air: float = 0.3,
    seed: int = 0,
    **adaptation: float,
) -> Scene:
    """A box of `footprint` (x, z) [m] with water of `depth` [m] and `air` [m] above it.

    layers = 1: uniform particles of `finest` spacing [m]; more: that many adaptive layers, each of
    twice the mass of the next finer, filled as the coarsest. Another `seed` is another start.
    """
    x, z = footprint
    mass = 1000.0 * finest**3
    body = {"layer": layers - 1, "lo": [0, 0, 0], "hi": [x, depth, z]}
    return Scene.model_validate(
        {
            "method": "projection",
            "seed": seed,
            "box": {"size": [x, depth + air, z]},
            "layers": [{"mass": mass * 2**k} for k in range(layers)],
            "water": [body],
            "adaptation": {"enabled": layers > 1, **adaptation},
        }
    )


@dataclass
class Reading:
    """The water frame by frame; energies in J, errors as shares (-)."""

    simulation: Simulation
    times: list[float] = field(default_factory=list)
    energies: list[float] = field(default_factory=list)
    kinetic: list[float] = field(default_factory=list)
    centres: list[np.ndarray] = field(default_factory=list)
    error_mean: list[float] = field(default_factory=list)
    error_p99: list[float] = field(default_factory=list)
    error_max: list[float] = field(default_factory=list)
    _pressure: np.ndarray = field(default_factory=lambda: np.zeros(SHEETS))
    _weight: np.ndarray = field(default_factory=lambda: np.zeros(SHEETS))

    def __post_init__(self):
        specs = self.simulation.layers.specs
        self._mass = np.array([s.mass for s in specs])
        self.depth = self._masses().sum() / 1000.0
        self.depth /= self.simulation.size[0] * self.simulation.size[2]

    def _masses(self) -> np.ndarray:
        return self._mass[self.simulation.particles.numpy("layer")]

    def read(self) -> None:
        """Adds the state of now."""
        sim, p = self.simulation, self.simulation.particles
        m, x, v = self._masses(), p.numpy("x").astype(float), p.numpy("v").astype(float)
        sim.measure_density()
        excess = np.maximum(p.numpy("density") / 1000.0 - 1.0, 0.0)
        self.times.append(sim.time)
        self.kinetic.append(0.5 * float((m * (v**2).sum(axis=1)).sum()))
        self.energies.append(self.kinetic[-1] + GRAVITY * float((m * x[:, 1]).sum()))
        self.centres.append((m[:, None] * x).sum(axis=0) / m.sum())
        self.error_mean.append(float((m * excess).sum() / m.sum()))
        self.error_p99.append(float(np.percentile(excess, 99.0)))
        self.error_max.append(float(excess.max()))
        hydrostatic = 1000.0 * GRAVITY * (self.depth - x[:, 1])
        sheet = np.clip((x[:, 1] / self.depth * SHEETS).astype(int), 0, SHEETS - 1)
        self._pressure += np.bincount(sheet, m * (p.numpy("pressure") - hydrostatic), SHEETS)
        self._weight += np.bincount(sheet, m, SHEETS)

    def pressure_error(self) -> float:
        """Root mean square over depth of the error of the mean pressure, over rho g H (-).

        Sheets weigh what water they hold: coarse particles leave sheets to a stray one.
        """
        mean = self._pressure / np.maximum(self._weight, 1e-9)
        square = np.average(mean**2, weights=self._weight)
        return float(np.sqrt(square) / (1000.0 * GRAVITY * self.depth))

    def energy_rise(self, seconds: float = 1.0) -> float:
        """Largest rise of the energy within `seconds`, over the potential energy over the floor."""
        e, n = np.array(self.energies), round(seconds / FRAME)
        rises = [e[k + 1 : k + 1 + n].max() - e[k] for k in range(len(e) - 1)]
        return max(0.0, max(rises)) / (1000.0 * GRAVITY * 0.5 * self.depth * self._volume())

    def volume_error(self) -> float:
        """Height of the centre over half the rest depth, less 1: of the last second (-)."""
        heights = np.array(self.centres)[-60:, 1]
        return float(heights.mean() / (0.5 * self.depth) - 1.0)

    def _volume(self) -> float:
        return float(self._masses().sum()) / 1000.0


class Profile:
    """Pressure over depth as probes in the middle of every sheet read it, frame by frame.

    Probes tell what is in a point; means of a sheet's own particles are as rough as the particles
    are thicker than the sheet.
    """

    def __init__(self, simulation: Simulation, depth: float):
        self.simulation, self.depth, self.frames = simulation, depth, 0
        self.heights = (np.arange(SHEETS) + 0.5) / SHEETS * depth
        x, _, z = simulation.size
        places = [(a * x, y, b * z) for y in self.heights for a, b in COLUMNS]
        self.points = np.array(places)
        self.sums = np.zeros(SHEETS)

    def read(self) -> None:
        """Adds the state of now."""
        # What is dry bears no pressure.
        pressures = np.nan_to_num(Snapshot.of(self.simulation).pressures(self.points))
        self.sums += pressures.reshape(SHEETS, -1).mean(axis=1)
        self.frames += 1

    def error(self) -> float:
        """Root mean square over depth of the error of the mean pressure, over rho g H (-)."""
        off = self.sums / self.frames - 1000.0 * GRAVITY * (self.depth - self.heights)
        return float(np.sqrt(np.mean(off**2)) / (1000.0 * GRAVITY * self.depth))


def run(simulation: Simulation, seconds: float, *readings: Reading | Profile) -> None:
    """Advances frame by frame under gravity, reading each."""
    for _ in range(round(seconds / FRAME)):
        simulation.advance(FRAME, ExternalForces(gravity=(0.0, -GRAVITY, 0.0)))
        for reading in readings:
            reading.read()


def build(scene: Scene) -> Simulation:
    return build_simulation(scene)


def slosh(simulation: Simulation, depth: float, amplitude: float) -> None:
    """Gives still water the velocities of the first sloshing mode along x as it passes rest.

    v_x = -a omega sin(kx) cosh(ky)/sinh(kH), v_y = a omega cos(kx) sinh(ky)/sinh(kH), k = pi/L.
    Displacing it instead upsets the arrangement, whose relaxation lifts the water.
    """
    length = simulation.size[0]
    k, omega = math.pi / length, 2.0 * math.pi / slosh_period(length, depth)
    p, n = simulation.particles, simulation.particles.count
    x, v = p.x.to_numpy()[:n], p.v.to_numpy()
    kx, ky, scale = k * x[:, 0], k * x[:, 1], amplitude * omega / math.sinh(k * depth)
    v[:n, 0] -= scale * np.sin(kx) * np.cosh(ky)
    v[:n, 1] += scale * np.cos(kx) * np.sinh(ky)
    p.v.from_numpy(v)


def slosh_period(length: float, depth: float) -> float:
    """Period [s] of the first mode of linear theory: omega^2 = g k tanh(k H), k = pi/L."""
    k = math.pi / length
    return 2.0 * math.pi / math.sqrt(GRAVITY * k * math.tanh(k * depth))


def fitted_period(times: list[float], values: np.ndarray, guess: float) -> float:
    """Period [s] of the damped cosine that fits best."""
    from scipy.optimize import curve_fit

    def wave(t, mean, a, b, rate, period):
        angle = 2.0 * np.pi * t / period
        return mean + np.exp(-rate * t) * (a * np.cos(angle) + b * np.sin(angle))

    start = (values.mean(), 0.0, values.min() - values.mean(), 0.1, guess)
    found, _ = curve_fit(wave, np.array(times), values, p0=start)
    return float(found[-1])
