"""From bodies of water to particles: lattices that hold the right mass and the right volume."""

import math

import numpy as np

from msph.fluid.adaptivity.bands import with_exact_ratios
from msph.fluid.methods import METHODS
from msph.fluid.particles.layers import LayerSpec
from msph.scene.schema import Scene, Water

# Particles that a pool has room for without being asked, where adaptation could need them.
MANY = 16_000
# How far bodies of water may touch or reach over the box before it counts as an error [m]:
# rounding in a scene file, not a design.
TOLERANCE = 1e-6
# Steps (-) of a sequence of low discrepancy in the plane, of powers of 1/1.3247 (Roberts 2018).
SCATTER = (0.7548776662, 0.5698402910)


def layer_specs(scene: Scene) -> list[LayerSpec]:
    """The scene's layers with mass and spacing resolved; see LayerSpec for units."""
    specs = []
    for layer in scene.layers:
        viscosity = scene.classic.viscosity if layer.viscosity is None else layer.viscosity
        specs.append(
            LayerSpec(
                mass=layer.mass_at(scene.density),
                density=scene.density,
                smoothing=layer.smoothing or METHODS[scene.method].SMOOTHING,
                gravity_factor=layer.gravity_factor,
                viscosity=viscosity,
                wendland=layer.kernels == "wendland",
            )
        )
    return with_exact_ratios(specs) if scene.adaptation.enabled else specs


def bounds(water: Water) -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper corner [m] of the box around a body of water, (3,) each."""
    if water.radius is not None:
        centre = np.array(water.centre)
        return centre - water.radius, centre + water.radius
    return np.array(water.lo), np.array(water.hi)


def particle_count(water: Water, spec: LayerSpec) -> int:
    """Particles of the body: its `count`, or its volume's to half a particle."""
    return water.count or max(1, round(volume(water) / spec.volume))


def volume(water: Water) -> float:
    """Volume [m^3] between the body's bounds, whatever its `count`."""
    if water.radius is not None:
        return 4.0 / 3.0 * math.pi * water.radius**3
    lo, hi = bounds(water)
    return float(np.prod(hi - lo))


def asked_mass(scene: Scene, specs: list[LayerSpec]) -> float:
    """Mass [kg] of water that the scene asks for: by volume, or by `count` where one is given."""
    return sum(
        scene.density * volume(w) if w.count is None else w.count * specs[w.layer].mass
        for w in scene.water
    )


def fill(water: Water, spec: LayerSpec, rng: np.random.Generator) -> np.ndarray:
    """Positions [m] of the body's particles, (n, 3), each with its rest volume to itself.

    A box is filled evenly from edge to edge; with a `count`, up to the height that so many need.
    """
    sites = _ball(water, spec) if water.radius is not None else _block(water, spec)
    return sites + rng.uniform(-0.5, 0.5, sites.shape) * water.jitter * spec.spacing


def _block(water: Water, spec: LayerSpec) -> np.ndarray:
    """Sites of a lattice in rows along the block's longest edge, whose spacings are alike.

    What the rows cannot share evenly, at most a particle each, goes to rows that lie scattered: so
    no sheet is incomplete, and density is even from the bottom to the surface.
    """
    lo, hi = bounds(water)
    length, count = hi - lo, particle_count(water, spec)
    if water.count is not None:
        length[1] = count * spec.volume / (length[0] * length[2])
    order = np.argsort(length, kind="stable")
    a, b, c = length[order]
    options = _divisions(np.array([a, b]) / spec.spacing)
    na, nb = min(options, key=lambda n: _stretch(a / n[0], b / n[1], c * n[0] * n[1] / count))
    i, j = np.divmod(np.arange(na * nb), nb)
    each, rest = divmod(count, na * nb)
    held = np.full(na * nb, each)
    held[np.argsort((i * SCATTER[0] + j * SCATTER[1]) % 1.0, kind="stable")[:rest]] += 1
    row = np.repeat(np.arange(na * nb), held)
    place = np.arange(count) - np.repeat(np.cumsum(held) - held, held)
    sites = np.empty((count, 3))
    sites[:, order[0]] = (i[row] + 0.5) * a / na
    sites[:, order[1]] = (j[row] + 0.5) * b / nb
    sites[:, order[2]] = (place + 0.5) * c / held[row]
    return lo + sites


def _divisions(spacings: np.ndarray) -> list[tuple[int, int]]:
    """Ways to divide edges that are so many spacings long, (2,), into whole cells."""
    down = np.maximum(np.floor(spacings), 1).astype(int)
    return [(down[0] + a, down[1] + b) for a in (0, 1) for b in (0, 1)]


def _stretch(*edges: float) -> float:
    """Longest edge of a cell over its shortest (-)."""
    return max(edges) / min(edges)


def _ball(water: Water, spec: LayerSpec) -> np.ndarray:
    """The sites of a cubic lattice that are nearest to the ball's centre."""
    centre, d, count = np.array(water.centre), spec.spacing, particle_count(water, spec)
    n = math.ceil((0.75 / math.pi * count) ** (1.0 / 3.0)) + 1
    axis = (np.arange(-n, n) + 0.5) * d
    grid = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)
    nearest = np.argsort((grid**2).sum(axis=1), kind="stable")[:count]
    return centre + grid[nearest]


def capacity(scene: Scene, specs: list[LayerSpec]) -> int:
    """Most particles that the scene's water may come to be."""
    counts = [particle_count(w, specs[w.layer]) for w in scene.water]
    if not scene.adaptation.enabled:
        return sum(counts)
    if scene.adaptation.capacity:
        return scene.adaptation.capacity
    filled = sum(n * specs[w.layer].volume for n, w in zip(counts, scene.water, strict=True))
    finest = math.ceil(filled / min(s.volume for s in specs))
    return min(finest, max(MANY, 2 * sum(counts)))


def initial_particles(scene: Scene, specs: list[LayerSpec]) -> dict[str, np.ndarray]:
    """Positions [m] and velocities [m/s], (n, 3), and layers, (n,), of all the scene's water."""
    rng = np.random.default_rng(scene.seed)
    xs, vs, layers = [], [], []
    for water in scene.water:
        spec = specs[water.layer]
        x = fill(water, spec, rng)
        # Half a spacing from the walls is where the solver would put them anyway.
        margin = 0.5 * spec.spacing
        x = np.clip(x, margin, np.array(scene.box.size) - margin)
        xs.append(x)
        vs.append(np.tile(water.velocity, (len(x), 1)))
        layers.append(np.full(len(x), water.layer))
    return {
        "x": np.concatenate(xs).astype(np.float32),
        "v": np.concatenate(vs).astype(np.float32),
        "layer": np.concatenate(layers).astype(np.int32),
    }
