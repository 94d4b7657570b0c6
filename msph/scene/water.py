"""Initial particles: lattices that fill the volumes of water at their exact mass and volume."""

import math

import numpy as np

from msph.fluid.adaptivity.bands import with_exact_ratios
from msph.fluid.boundary.rigid_bodies import Ball, Block, volume
from msph.fluid.methods import METHODS
from msph.fluid.particles.layers import LayerSpec
from msph.scene.openings import inflow_volumes
from msph.scene.schema import BodyEntry, Scene, Water

# Least default capacity [particles] with adaptation, unless water of the finest layer needs less.
MIN_ADAPTIVE_CAPACITY = 16_000
# Steps (-) of the two-dimensional low-discrepancy sequence R2, powers of 1/1.3247 (Roberts 2018).
R2_STEPS = (0.7548776662, 0.5698402910)


def layer_specs(scene: Scene) -> list[LayerSpec]:
    """Returns the scene's layers with mass and spacing resolved; see LayerSpec for units."""
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


def shape_of(given: Water | BodyEntry) -> Ball | Block:
    """Returns the ball or box of a volume of water, or of a body without a mesh."""
    if given.radius is not None:
        return Ball(np.array(given.centre, float), given.radius)
    return Block(np.array(given.lo, float), np.array(given.hi, float))


def particle_count(water: Water, spec: LayerSpec) -> int:
    """Returns the number of particles: `count`, or the volume over the particle volume."""
    return water.count or max(1, round(volume(shape_of(water)) / spec.volume))


def specified_mass(scene: Scene, specs: list[LayerSpec]) -> float:
    """Returns the mass [kg] of water in the scene file: by volume, or by `count` where given."""
    return sum(
        scene.density * volume(shape_of(w)) if w.count is None else w.count * specs[w.layer].mass
        for w in scene.water
    )


def fill(water: Water, spec: LayerSpec, rng: np.random.Generator) -> np.ndarray:
    """Returns the positions [m] of the particles, (n, 3), at rest density.

    A box is filled evenly from edge to edge; with a `count`, up to the height of its volume.
    """
    sites = _ball(water, spec) if water.radius is not None else _block(water, spec)
    return sites + rng.uniform(-0.5, 0.5, sites.shape) * water.jitter * spec.spacing


def _block(water: Water, spec: LayerSpec) -> np.ndarray:
    """Returns sites [m], (n, 3), of a nearly cubic lattice in rows along the block's longest edge.

    The remainder of n over the number of rows adds one particle each to rows spread by the R2
    sequence, so that the density is even from the bottom to the surface.
    """
    lo, hi = shape_of(water).bounds
    length, count = hi - lo, particle_count(water, spec)
    if water.count is not None:
        length[1] = count * spec.volume / (length[0] * length[2])
    order = np.argsort(length, kind="stable")
    a, b, c = length[order]
    na, nb = np.maximum(np.floor(np.array([a, b]) / spec.spacing), 1).astype(int)
    options = [(na + i, nb + j) for i in (0, 1) for j in (0, 1)]
    na, nb = min(options, key=lambda n: _aspect(a / n[0], b / n[1], c * n[0] * n[1] / count))
    i, j = np.divmod(np.arange(na * nb), nb)
    each, rest = divmod(count, na * nb)
    in_row = np.full(na * nb, each)
    in_row[np.argsort((i * R2_STEPS[0] + j * R2_STEPS[1]) % 1.0, kind="stable")[:rest]] += 1
    row = np.repeat(np.arange(na * nb), in_row)
    place = np.arange(count) - np.repeat(np.cumsum(in_row) - in_row, in_row)
    sites = np.empty((count, 3))
    sites[:, order[0]] = (i[row] + 0.5) * a / na
    sites[:, order[1]] = (j[row] + 0.5) * b / nb
    sites[:, order[2]] = (place + 0.5) * c / in_row[row]
    return lo + sites


def _aspect(*edges: float) -> float:
    """Returns the aspect ratio of a cell: longest edge over shortest (-)."""
    return max(edges) / min(edges)


def _ball(water: Water, spec: LayerSpec) -> np.ndarray:
    """Returns the sites [m] of a cubic lattice nearest to the ball's centre, (n, 3)."""
    centre, d, count = np.array(water.centre), spec.spacing, particle_count(water, spec)
    n = math.ceil((0.75 / math.pi * count) ** (1.0 / 3.0)) + 1
    axis = (np.arange(-n, n) + 0.5) * d
    grid = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)
    nearest = np.argsort((grid**2).sum(axis=1), kind="stable")[:count]
    return centre + grid[nearest]


def capacity(scene: Scene, specs: list[LayerSpec]) -> int:
    """Returns the largest number of particles that the simulation can hold."""
    counts = [(w.layer, particle_count(w, specs[w.layer])) for w in scene.water]
    for layer, entering in inflow_volumes(scene, specs):
        counts.append((layer, math.ceil(entering / specs[layer].volume)))
    total = sum(n for _, n in counts)
    if not scene.adaptation.enabled:
        return total
    if scene.adaptation.capacity:
        return scene.adaptation.capacity
    filled = sum(n * specs[layer].volume for layer, n in counts)
    finest = math.ceil(filled / min(s.volume for s in specs))
    return min(finest, max(MIN_ADAPTIVE_CAPACITY, 2 * total))


def initial_particles(scene: Scene, specs: list[LayerSpec]) -> dict[str, np.ndarray]:
    """Returns the initial positions [m] and velocities [m/s], (n, 3), and layers, (n,), by name."""
    rng = np.random.default_rng(scene.seed)
    xs, vs, layers = [], [], []
    for water in scene.water:
        spec = specs[water.layer]
        x = fill(water, spec, rng)
        # Random displacements leave particles at least half a spacing from the walls.
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
