"""From bodies of water to particles: lattices that hold the right mass and the right volume."""

import math

import numpy as np

from msph.fluid.adaptation import exact
from msph.fluid.layers import LayerSpec
from msph.scene.schema import Scene, Water

# Support over spacing. Narrow kernels make an arrangement under pressure stiff against shear, as
# soft solids are, and waves too fast: at 2 by 12 % with Wendland C2, at 2.2 by 2.4 (uniform) and
# 3.2 % (layers) with the quartic. Wide ones smooth waves and make them slow, as the square of the
# spacing. At 2.5 layered water 15 spacings deep sloshes up to 1.1 % too slow, at 2.4 such water 20
# deep 1.1 % too fast, at 2.45 both are off by .2 to .9 %: about 700/N^2 - 46/N % at N spacings,
# which is least, -.8 %, at 30.
SMOOTHING = {"classic": 2.0, "projection": 2.45}
# Particles that a pool has room for without being asked, where adaptation could need them.
MANY = 30_000


def layer_specs(scene: Scene) -> list[LayerSpec]:
    """The scene's layers with mass and spacing resolved; see LayerSpec for units."""
    specs = []
    for layer in scene.layers:
        viscosity = scene.classic.viscosity if layer.viscosity is None else layer.viscosity
        specs.append(
            LayerSpec(
                mass=layer.mass_at(scene.density),
                density=scene.density,
                smoothing=layer.smoothing or SMOOTHING[scene.method],
                gravity_factor=layer.gravity_factor,
                viscosity=viscosity,
                wendland=layer.kernels == "wendland",
            )
        )
    return exact(specs) if scene.adaptation.enabled else specs


def bounds(water: Water) -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper corner [m] of the box around a body of water, (3,) each."""
    if water.radius is not None:
        centre = np.array(water.centre)
        return centre - water.radius, centre + water.radius
    return np.array(water.lo), np.array(water.hi)


def expected_count(water: Water, spec: LayerSpec) -> int:
    """About how many particles the body will have, without making them."""
    if water.count is not None:
        return water.count
    if water.radius is not None:
        volume = 4.0 / 3.0 * math.pi * water.radius**3
    else:
        lo, hi = bounds(water)
        volume = float(np.prod(hi - lo))
    return max(1, math.ceil(volume / spec.volume))


def fill(water: Water, spec: LayerSpec, rng: np.random.Generator) -> np.ndarray:
    """Positions [m] of the body's particles, (n, 3), each with its rest volume to itself.

    In a box the lattice is fitted to the edges, the spacings of its axes chosen so that their
    product stays the volume of a particle. With a `count` it is laid from the bottom, and the
    last, incomplete sheet is spread evenly.
    """
    if water.radius is not None:
        sites = _ball(water, water.radius, spec)
    else:
        sites = _sheets(water, spec)
    return sites + rng.uniform(-0.5, 0.5, sites.shape) * water.jitter * spec.spacing


def _sheets(water: Water, spec: LayerSpec) -> np.ndarray:
    lo, hi = bounds(water)
    length = hi - lo
    nx, nz = min(_divisions(length[[0, 2]] / spec.spacing), key=lambda n: _stretch(length, n, spec))
    sheet, height = nx * nz, _height(length, (nx, nz), spec)
    count = water.count or sheet * max(1, round(length[1] / height))
    full, rest = divmod(count, sheet)
    cells = np.arange(full * sheet)
    if rest:
        spread = np.floor((np.arange(rest) + 0.5) * sheet / rest).astype(int)
        cells = np.concatenate([cells, full * sheet + spread])
    row, column = np.divmod(cells % sheet, nz)
    sites = np.stack([(row + 0.5) / nx, (cells // sheet + 0.5), (column + 0.5) / nz], axis=1)
    return lo + sites * np.array([length[0], height, length[2]])


def _divisions(spacings: np.ndarray) -> list[tuple[int, int]]:
    """Ways to divide edges that are so many spacings long, (2,), into whole cells."""
    down = np.maximum(np.floor(spacings), 1).astype(int)
    return [(down[0] + a, down[1] + b) for a in (0, 1) for b in (0, 1)]


def _height(length: np.ndarray, divisions: tuple[int, int], spec: LayerSpec) -> float:
    """Height [m] of cells of a particle's volume."""
    return spec.volume * divisions[0] * divisions[1] / (length[0] * length[2])


def _stretch(length: np.ndarray, divisions: tuple[int, int], spec: LayerSpec) -> float:
    """Longest edge of such cells over their shortest (-)."""
    edges = length[0] / divisions[0], _height(length, divisions, spec), length[2] / divisions[1]
    return max(edges) / min(edges)


def _ball(water: Water, radius: float, spec: LayerSpec) -> np.ndarray:
    centre, d = np.array(water.centre), spec.spacing
    n = math.ceil(radius / d)
    axis = (np.arange(-n, n) + 0.5) * d
    grid = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)
    # The sites nearest to the centre, as many as the volume asks for: the mass is right.
    wanted = max(1, round(4.0 / 3.0 * math.pi * radius**3 / spec.volume))
    wanted = water.count or wanted
    nearest = np.argsort((grid**2).sum(axis=1), kind="stable")[:wanted]
    return centre + grid[nearest]


def capacity(scene: Scene) -> int:
    """Most particles that the scene's water may come to be."""
    specs = layer_specs(scene)
    counts = [expected_count(w, specs[w.layer]) for w in scene.water]
    if not scene.adaptation.enabled or scene.method != "projection":
        return sum(counts)
    if scene.adaptation.capacity:
        return scene.adaptation.capacity
    volume = sum(n * specs[w.layer].volume for n, w in zip(counts, scene.water, strict=True))
    finest = math.ceil(volume / min(s.volume for s in specs))
    return min(finest, max(MANY, 2 * sum(counts)))


def initial_particles(scene: Scene) -> dict[str, np.ndarray]:
    """Positions [m] and velocities [m/s], (n, 3), and layers, (n,), of all the scene's water."""
    rng = np.random.default_rng(scene.seed)
    specs = layer_specs(scene)
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
