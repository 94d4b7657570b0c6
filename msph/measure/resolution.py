"""Resolution of a scene: how many of its finest spacings fit across water, gaps and bodies."""

import itertools
import math
from collections.abc import Sequence

import numpy as np

from msph.fluid.boundary.rigid_bodies import TOUCHING, Ball, Block, Body, Solid
from msph.fluid.plan import Plan
from msph.measure.body_faces import faces

# Points on the surface of a body between which gaps are sought: they lie 1 % of its size apart.
POINTS = 20_000


def resolution(plan: Plan, depth: float = math.nan) -> dict[str, float]:
    """Finest and coarsest spacing [m] and, in finest spacings (-): the water's mean `depth` [m];
    the narrowest gap that the bodies leave where they stand at the start, or the box's shortest
    edge; the thickness of each body.

    What is not known, or of which there is none, is NaN or left out.
    """
    spacings = [s.spacing for s in plan.specs]
    d = min(spacings)
    across = {
        f"spacings_across_obstacles.{i}": thickness(b) / d
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
    """Twice the height [m] of the centre of mass over the lowest corner of box or container, mean
    over `centres` (n, 3) [m] under `gravity` [m/s^2]: the depth of water that stands level. NaN
    without gravity."""
    if not any(gravity):
        return math.nan
    lo, hi = np.zeros(3), np.array(plan.size)
    for container in filter(_contains, plan.bodies):
        lo, hi = container.bounds
    up = -np.array(gravity) / np.linalg.norm(gravity)
    lowest = np.where(up > 0.0, lo, hi)
    return float(2.0 * ((centres - lowest) @ up).mean())


def narrowest_gap(size: tuple[float, float, float], solids: Sequence[Body], d: float) -> float:
    """Least distance [m] between opposite walls, a body and a wall, or two bodies; what is nearer
    than half a spacing d [m] touches. Between two bodies good to 1 % of their size."""
    walls = np.array(size)
    lo, hi = np.zeros(3), walls
    for container in filter(_contains, solids):
        lo, hi = container.bounds
    gaps = list(hi - lo)
    for body in solids:
        if not _contains(body) and not any(map(_contains, solids)):
            gaps += [*body.bounds[0], *(walls - body.bounds[1])]
    clouds = []
    # Here, since trimesh and scipy take .5 s and most scenes have no bodies.
    if len(solids) > 1:
        from scipy.spatial import cKDTree
        from trimesh.sample import sample_surface

        clouds = [sample_surface(faces(b), POINTS, seed=0)[0] for b in solids]
    for a, b in itertools.combinations(clouds, 2):
        gaps.append(cKDTree(a).query(b)[0].min())
    return float(min(g for g in gaps if g > TOUCHING * d))


def thickness(body: Body) -> float:
    """Shortest edge [m] of the narrowest box round a body."""
    if isinstance(body, Ball):
        return 2.0 * body.radius
    if isinstance(body, Block):
        return float((body.hi - body.lo).min())
    from trimesh.bounds import oriented_bounds

    _, edges = oriented_bounds(faces(body))
    return float(edges.min())


def _contains(body: Body) -> bool:
    return isinstance(body, Solid) and body.container
