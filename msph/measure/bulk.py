"""Bulk density: how densely particles stand inside the water, from their positions alone.

A solver's own density error can read small while the water loses a fifth of its volume. This
measure shares nothing with any solver: kernel, walls and the choice of points are its own.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import distance_transform_edt
from scipy.spatial import cKDTree

from msph.measure.host_kernels import mirrored, wendland

# Radius of the wide kernel, in spacings of the coarsest particles that it meets. On lattices the
# sum then lies within .2 % of the true density everywhere, and within .1 % in the mean.
WIDE = 3.5
# A place farther than this from every particle, in the particle's spacings, is air. Evenly spread
# particles leave no hole deeper than .87; one that is missing leaves one of 1.
HOLE = 1.25
# Half a spacing is water beyond the last centre; the rest of HOLE is air counted as water.
RIND = HOLE - 0.5
# Places where the density is sampled, and voxels in which air is sought: enough for .1 %.
POINTS, MOST_VOXELS = 400, 300_000
# Room that lies deep enough must be this many (finest spacings)^3, one kernel's volume: less is a
# single place, not the bulk.
LEAST_ROOM = 4.0 / 3.0 * np.pi * WIDE**3
# Share of the places at which the density must be known: the mean of a handful is a single place's
# too, and in a dam break's splashes read up to 1.6 % off.
LEAST_SHARE = 0.1
# Half the diagonal of a cube, over its edge.
HALF_DIAGONAL = 0.5 * 3.0**0.5


@dataclass(frozen=True)
class BulkDensity:
    """sum V_j W over rest, 1 for water at rest density: mean, least and most over `points` places.

    NaN where too little lies deep enough.
    """

    mean: float
    least: float
    most: float
    points: int


def bulk_density(
    x: np.ndarray,
    spacing: np.ndarray,
    size: tuple[float, float, float],
    free: Callable[[np.ndarray, float], np.ndarray] | None = None,
    points: int = POINTS,
    seed: int = 0,
) -> BulkDensity:
    """Density of particles at x (n, 3) [m], each d^3 in volume for its spacing d (n,) [m].

    Weighed by volume, at random places of the water whose whole wide kernel lies in it. The places
    do not depend on where single particles are: at a particle the sum would be too large.
    free(x, margin) tells which points x (m, 3) [m] are `margin` [m] outside of all bodies.
    """
    rng = np.random.default_rng(seed)
    clearance, edge = _clearance(x, spacing, size, free)
    finest, coarsest = spacing.min(), spacing.max()
    deep = np.argwhere(clearance > _needed(finest, edge))
    if len(deep) * edge**3 < LEAST_ROOM * finest**3:
        return BulkDensity(np.nan, np.nan, np.nan, 0)
    deep = deep[rng.integers(len(deep), size=points)]
    places = (deep + rng.random(deep.shape)) * edge
    room = clearance[tuple(deep.T)]
    inside = np.all(places < np.array(size), axis=1)
    places, room = places[inside], room[inside]
    x, which = mirrored(x, size, WIDE * coarsest)
    spacing = spacing[which]
    tree = cKDTree(x)
    found = np.full(len(places), np.nan)
    sizes = np.unique(spacing)
    trees = {d: cKDTree(x[spacing == d]) for d in sizes}
    # From fine to coarse: the first kernel wide enough for all whose volume it meets.
    for d in sizes:
        open_ = np.flatnonzero(np.isnan(found) & (room > _needed(d, edge)))
        for coarser in sizes[sizes > d]:
            distance, _ = trees[coarser].query(places[open_])
            open_ = open_[distance > WIDE * d + HALF_DIAGONAL * coarser]
        near = tree.query_ball_point(places[open_], WIDE * d)
        for place, ids in zip(open_, near, strict=True):
            r = np.linalg.norm(x[ids] - places[place], axis=1)
            found[place] = (spacing[ids] ** 3 * wendland(r, WIDE * d)).sum()
    known = found[~np.isnan(found)]
    if len(known) < LEAST_SHARE * points:
        return BulkDensity(np.nan, np.nan, np.nan, 0)
    return BulkDensity(float(known.mean()), float(known.min()), float(known.max()), len(known))


def _needed(d: float, edge: float) -> float:
    """Clearance of a voxel of `edge` [m] that has room for the kernel of spacing d [m] anywhere."""
    return WIDE * d + RIND * d + 2.0 * HALF_DIAGONAL * edge


def _clearance(x: np.ndarray, spacing: np.ndarray, size, free) -> tuple[np.ndarray, float]:
    """Distance [m] of every voxel to the nearest one of air or a body, walls being water, and the
    edge [m] of a voxel."""
    edge = max(float(spacing.min()), float(np.prod(size) / MOST_VOXELS) ** (1.0 / 3.0))
    shape = [int(np.ceil(length / edge)) for length in size]
    centres = (np.indices(shape).reshape(3, -1).T + 0.5) * edge
    water = np.zeros(len(centres), dtype=bool)
    for d in np.unique(spacing):
        tree = cKDTree(x[spacing == d])
        dry = np.flatnonzero(~water)
        distance, _ = tree.query(centres[dry], distance_upper_bound=HOLE * d)
        water[dry] = np.isfinite(distance)
    if free is not None:
        water &= free(centres, HALF_DIAGONAL * edge)
    water = water.reshape(shape)
    if water.all():
        return np.full(shape, np.inf), edge
    return distance_transform_edt(water) * edge, edge
