"""Building and checking the inflows and outflows of a scene."""

import math

import numpy as np

from msph.expressions import OverTime
from msph.fluid.adaptivity.bands import bands
from msph.fluid.boundary.opening import ZONE, Opening
from msph.fluid.boundary.walls import wall_constants
from msph.fluid.methods import METHODS, methods_with
from msph.fluid.particles.layers import LayerSpec
from msph.parameter import MAX_SPEED
from msph.scene import schema
from msph.scene.errors import explaining, is_one_of, require, require_layer
from msph.scene.motion import TRIALS, over
from msph.scene.schema import Scene

# Litres per cubic metre.
LITRES = 1000.0


def openings(scene: Scene, specs: list[LayerSpec]) -> list[Opening]:
    """Returns the openings of a checked scene, inflows first."""
    return [opening(scene, given, specs, key) for key, given in tables(scene)]


def tables(scene: Scene) -> list[tuple[str, schema.OpeningEntry]]:
    """Returns the inflows and outflows of a scene with their keys."""
    found: list[tuple[str, schema.OpeningEntry]] = []
    found += [(f"inflows.{k}", each) for k, each in enumerate(scene.inflows)]
    return found + [(f"outflows.{k}", each) for k, each in enumerate(scene.outflows)]


def opening(scene: Scene, given: schema.OpeningEntry, specs: list[LayerSpec], key: str) -> Opening:
    """Returns the opening of the table `key` of a scene. Raises ExpressionError."""
    centre, half, edges = shape(given)
    enters = isinstance(given, schema.Inflow)
    layer = given.layer if isinstance(given, schema.Inflow) else None
    if layer is None:
        layer = layer_at(scene, centre, specs)
    made = Opening(
        centre=centre,
        direction=direction(scene, given, centre, specs[layer].spacing),
        half=half,
        enters=enters,
        edges=edges,
        layer=layer,
        speed=None,
    )
    flow = given.speed if given.rate is None else given.rate
    if flow is None:
        return made
    name, share = ("speed", 1.0) if given.rate is None else ("rate", 1.0 / (LITRES * made.area))
    found = OverTime(flow, scene.duration, f"{key}.{name}", 0.0, MAX_SPEED / share)
    return Opening(**{**vars(made), "speed": lambda time: share * found(time)})


def shape(given: schema.OpeningEntry) -> tuple[np.ndarray, tuple[float, float], np.ndarray | None]:
    """Returns centre [m], half extents [m] and edges of the cross-section; see Opening."""
    if given.radius is not None:
        return np.array(given.centre, float), (given.radius, given.radius), None
    lo, hi = np.array(given.lo, float), np.array(given.hi, float)
    a, b = np.flatnonzero(hi > lo)
    half = 0.5 * (hi - lo)
    return 0.5 * (lo + hi), (float(half[a]), float(half[b])), np.eye(3)[[a, b]]


def direction(
    scene: Scene, given: schema.OpeningEntry, centre: np.ndarray, spacing: float
) -> np.ndarray:
    """Returns the direction (3,) of the flow: as given, or through the wall next to the centre and
    normal to a rectangle, or down if there is no such wall."""
    if given.direction is not None:
        return np.array(given.direction, float)
    enters = isinstance(given, schema.Inflow)
    for inwards in (*np.eye(3), *-np.eye(3)):
        way = inwards if enters else -inwards
        made = Opening(centre, way, (spacing, spacing), enters)
        flat = given.radius is not None or not np.any(np.abs(shape(given)[2] @ way))  # type: ignore[operator]
        if flat and made.wall(walls(scene), spacing):
            return way
    return np.array([0.0, -1.0, 0.0])


def walls(scene: Scene) -> np.ndarray:
    """Returns the coordinates (3,) [m] of the far walls."""
    return np.array(wall_constants(scene.box.size, scene.box.open)["walls"])


def layer_at(scene: Scene, x: np.ndarray, specs: list[LayerSpec]) -> int:
    """Returns the layer whose band contains the depth of x [m] below the boxes of water at the
    start; without adaptation, the layer of the first volume of water."""
    if not scene.adaptation.enabled:
        return scene.water[0].layer
    tops = [
        w.hi[1] - x[1]
        for w in scene.water
        if w.lo and w.hi and all(w.lo[k] <= x[k] <= w.hi[k] for k in (0, 2))
    ]
    depth = max([0.0, *tops])
    found = bands(specs, scene.adaptation.band)
    return next(k for k, (top, bottom) in enumerate(found) if top <= depth < bottom)


def inflow_volumes(scene: Scene, specs: list[LayerSpec]) -> list[tuple[int, float]]:
    """Returns layer and volume [m^3] of the water that each inflow adds within the duration, its
    pipe included; the sum is at most the volume of the box."""
    times = np.linspace(0.0, scene.duration, TRIALS)
    found = []
    for each in openings(scene, specs):
        if each.enters and each.speed is not None:
            way = float(np.trapezoid([each.speed(t) for t in times.tolist()], times))
            way += (ZONE + 1.0) * specs[each.layer].spacing
            found.append((each.layer, each.area * way))
    box = math.prod(scene.box.size)
    share = min(1.0, box / max(sum(v for _, v in found), box))
    return [(layer, share * volume) for layer, volume in found]


def check_openings(scene: Scene, specs: list[LayerSpec]) -> None:
    """Raises SceneError for an inflow or outflow that cannot be built."""
    for key, given in tables(scene):
        able = methods_with("HAS_OPENINGS")
        problem = f"the method {scene.method} has no inflows and outflows; {able} has"
        require(METHODS[scene.method].HAS_OPENINGS, key.split(".")[0], problem)
        _check_shape(given, key)
        require(given.speed is None or given.rate is None, key, "give either speed or rate")
        if isinstance(given, schema.Inflow):
            flows = given.speed is not None or given.rate is not None
            require(flows, key, "give a speed or a rate")
            require_layer(given.layer or 0, len(specs), key)
        points = given.direction is None or any(given.direction)
        require(points, f"{key}.direction", "has no direction")
        # The message of an expression names its key.
        with explaining(""):
            made = opening(scene, given, specs, key)
            if made.speed:
                over(scene.duration, made.speed)
        normal = made.edges is None or np.abs(made.edges @ made.along).max() <= 1e-6
        require(normal, f"{key}.direction", "must be normal to the rectangle")
        problem = made.problem(walls(scene), specs[made.layer].spacing) or ""
        require(not problem, key, problem)
        free = scene.container is None or not made.wall(walls(scene), specs[made.layer].spacing)
        require(free, key, "lies on a wall of the box, outside the container")


def _check_shape(given: schema.OpeningEntry, key: str) -> None:
    single = is_one_of((given.centre, given.radius), (given.lo, given.hi))
    require(single, key, "give either centre and radius, or lo and hi")
    if given.lo is not None and given.hi is not None:
        edges = np.array(given.hi) - np.array(given.lo)
        flat = np.all(edges >= 0.0) and (edges > 0.0).sum() == 2
        require(flat, f"{key}.hi", "lo and hi must differ along two axes, and lo be below hi")
