"""Resolution of a scene: finest spacings across the water's depth, gaps and bodies."""

import itertools
import math
from collections.abc import Sequence

import numpy as np

from msph.fluid.boundary.body_faces import faces
from msph.fluid.boundary.rigid_bodies import TOUCHING, Ball, Block, Body, Solid
from msph.fluid.plan import Plan

# Number of points on a body's surface for distances between bodies: 1 % of the body's size apart.
POINTS = 20_000


def resolution(plan: Plan, depth: float = math.nan) -> dict[str, float]:
    """Returns the finest and coarsest spacing [m] and, in finest spacings (-): the water's mean
    `depth` [m], the narrowest gap at the start, and the thickness of each body.

    Unknown values are NaN.
    """
    spacings = [s.spacing for s in plan.specs]
    d = min(spacings)
    across = {
        f"spacings_across_bodies.{i}": thickness(b) / d
        for i, b in enumerate(b for b in plan.bodies if not _contains(b))
    }
    return {
        "finest_spacing_m": d,
        "coarsest_spacing_m": max(spacings),
        "spacings_across_depth": depth / d,
        "spacings_across_narrowest_gap": narrowest_gap(plan.size, plan.bodies, d) / d,
        **across,
    }


def mean_depth(gravity: tuple[float, float, float], plan: Plan, centres: np.ndarray) -> float:
    """Returns the mean depth [m] of level water: twice the height of the centre of mass above the
    lowest corner of box or container, mean over `centres` (n, 3) [m]; NaN without `gravity`
    [m/s^2]."""
    if not any(gravity):
        return math.nan
    lo, hi = _room(plan.size, plan.bodies)
    up = -np.array(gravity) / np.linalg.norm(gravity)
    lowest = np.where(up > 0.0, lo, hi)
    return float(2.0 * ((centres - lowest) @ up).mean())


def narrowest_gap(size: tuple[float, float, float], solids: Sequence[Body], d: float) -> float:
    """Returns the least distance [m] above half a spacing d [m] between opposite walls, a body and
    a wall, or two bodies; the distance of two bodies is within 1 % of their size."""
    lo, hi = _room(size, solids)
    gaps = list(hi - lo)
    if not any(map(_contains, solids)):
        for body in solids:
            gaps += [*body.bounds[0], *(hi - body.bounds[1])]
    clouds = []
    # Imported here, as they take 0.5 s and most scenes have no bodies.
    if len(solids) > 1:
        from scipy.spatial import cKDTree
        from trimesh.sample import sample_surface

        clouds = [sample_surface(faces(b), POINTS, seed=0)[0] for b in solids]
    for a, b in itertools.combinations(clouds, 2):
        gaps.append(cKDTree(a).query(b)[0].min())
    return float(min(g for g in gaps if g > TOUCHING * d))


def thickness(body: Body) -> float:
    """Returns the shortest edge [m] of a body's smallest oriented bounding box."""
    if isinstance(body, Ball):
        return 2.0 * body.radius
    if isinstance(body, Block):
        return float((body.hi - body.lo).min())
    from trimesh.bounds import oriented_bounds

    _, edges = oriented_bounds(faces(body))
    return float(edges.min())


def _room(
    size: tuple[float, float, float], solids: Sequence[Body]
) -> tuple[np.ndarray, np.ndarray]:
    """Returns the lower and upper corner (3,) [m] of the container, or of the box without one."""
    container = next(filter(_contains, solids), None)
    return container.bounds if container else (np.zeros(3), np.array(size))


def _contains(body: Body) -> bool:
    return isinstance(body, Solid) and body.container
