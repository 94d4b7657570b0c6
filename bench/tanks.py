"""Tanks of uniform or layered water for benchmarks, and measurements on them."""

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
# Number of horizontal slices of a depth profile, and positions of the probes in each slice, (x, z)
# over the footprint.
SLICES = 12
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

    layers: 1 for uniform particles of `finest` spacing [m]; otherwise the number of adaptive
    layers, each of twice the mass of the next finer; the water is filled with the coarsest. seed:
    of the random initial displacements.
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
    """Measurements of the water at each read(): times [s], energies [J], density errors (-)."""

    simulation: Simulation
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
        specs = self.simulation.layers.specs
        self._mass = np.array([s.mass for s in specs])
        self.depth = self._masses().sum() / 1000.0
        self.depth /= self.simulation.size[0] * self.simulation.size[2]

    def _masses(self) -> np.ndarray:
        return self._mass[self.simulation.particles.numpy("layer")]

    def read(self) -> None:
        """Adds the current state."""
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
        slice_ = np.clip((x[:, 1] / self.depth * SLICES).astype(int), 0, SLICES - 1)
        self._pressure += np.bincount(slice_, m * (p.numpy("pressure") - hydrostatic), SLICES)
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
        e, n = np.array(self.energies), round(seconds / FRAME)
        rises = [e[k + 1 : k + 1 + n].max() - e[k] for k in range(len(e) - 1)]
        return max(0.0, max(rises)) / (1000.0 * GRAVITY * 0.5 * self.depth * self._volume())

    def volume_error(self) -> float:
        """Returns the height of the centre of mass in the last second over half the depth, minus
        1."""
        heights = np.array(self.centres)[-60:, 1]
        return float(heights.mean() / (0.5 * self.depth) - 1.0)

    def _volume(self) -> float:
        return float(self._masses().sum()) / 1000.0


class Profile:
    """Pressure over depth, measured by probes at the centre of every slice at each read().

    Means over the particles of a slice are inaccurate where particles are larger than the slice.
    """

    def __init__(self, simulation: Simulation, depth: float):
        self.simulation, self.depth, self.frames = simulation, depth, 0
        self.heights = (np.arange(SLICES) + 0.5) / SLICES * depth
        x, _, z = simulation.size
        places = [(a * x, y, b * z) for y in self.heights for a, b in COLUMNS]
        self.points = np.array(places)
        self.sums = np.zeros(SLICES)

    def read(self) -> None:
        """Adds the current state."""
        # The pressure of dry points is 0.
        pressures = np.nan_to_num(Snapshot.of(self.simulation).pressures(self.points))
        self.sums += pressures.reshape(SLICES, -1).mean(axis=1)
        self.frames += 1

    def error(self) -> float:
        """Returns the root mean square over depth of the error of the mean pressure, over rho g
        H."""
        off = self.sums / self.frames - 1000.0 * GRAVITY * (self.depth - self.heights)
        return float(np.sqrt(np.mean(off**2)) / (1000.0 * GRAVITY * self.depth))


def run(simulation: Simulation, seconds: float, *readings: Reading | Profile) -> None:
    """Advances the simulation under gravity and reads all readings after each frame."""
    for _ in range(round(seconds / FRAME)):
        simulation.advance(FRAME, ExternalForces(gravity=(0.0, -GRAVITY, 0.0)))
        for reading in readings:
            reading.read()


def build(scene: Scene) -> Simulation:
    """Builds the simulation of a scene."""
    return build_simulation(scene)


def slosh(simulation: Simulation, depth: float, amplitude: float) -> None:
    """Adds the velocities of the first sloshing mode along x at its zero crossing.

    v_x = -a omega sin(kx) cosh(ky)/sinh(kH), v_y = a omega cos(kx) sinh(ky)/sinh(kH), k = pi/L.
    amplitude [m] of the surface. Displaced particles would be less evenly arranged, and the water
    would rise as they rearrange.
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
    """Returns the period [s] of the first mode: omega^2 = g k tanh(k H), k = pi/L."""
    k = math.pi / length
    return 2.0 * math.pi / math.sqrt(GRAVITY * k * math.tanh(k * depth))


def fitted_period(times: list[float], values: np.ndarray, guess: float) -> float:
    """Returns the period [s] of the damped cosine that fits best."""
    return fitted_wave(times, values, guess)[1]


def fitted_wave(times: list[float], values: np.ndarray, guess: float) -> tuple[float, float]:
    """Returns the decay rate [1/s] and the period [s] of the damped cosine that fits best."""
    from scipy.optimize import curve_fit

    def wave(t, mean, a, b, rate, period):
        angle = 2.0 * np.pi * t / period
        return mean + np.exp(-rate * t) * (a * np.cos(angle) + b * np.sin(angle))

    start = (values.mean(), 0.0, values.min() - values.mean(), 0.1, guess)
    found, _ = curve_fit(wave, np.array(times), values, p0=start)
    return float(found[3]), float(found[4])
