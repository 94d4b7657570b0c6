"""Density errors of exported particles, with NumPy and SciPy only.

python bench/density_check.py STATE.npz [--density 1000] [--seed 0]

STATE.npz: of `msph capture --particles state_%04d.npz` or `msph measure` (checkpoint.npz). The file
holds positions x (n, 3) [m], the layer of each particle, and `fluid`: three edges of the box [m]
and the mass of a particle of each layer [kg]. Nothing is imported from msph.

- Kernel density error: c_i = sum_j V_j W(r_ij, h_ij) over all particles, i included, and their
  images in the walls of the box; W is the quartic B-spline M5, h = 2.45 spacings, h_ij the power
  mean of both with the exponent 2.5. Mean and 99th percentile over particles of max(c - 1, 0).
- Bulk density error: mass over volume in Epanechnikov kernels of 3.5 spacings at random points of
  which the whole kernel lies in the water, minus 1; narrower kernels where no water is as deep.

The walls of an open box mirror above its rim, too. Bodies count as air: next to them kernel sums
are too small, and there are no points.
"""

import argparse

import numpy as np
from scipy.ndimage import distance_transform_edt
from scipy.spatial import cKDTree

SUPPORT, EXPONENT = 2.45, 2.5
# Radii [spacings] of the wide kernel, number of points, and share of points that suffices.
WIDE, POINTS, ENOUGH = (3.5, 3.0, 2.5, 2.0), 1600, 0.1
# A point farther than this from every particle is air; water ends half a spacing beyond the last
# particle [spacings].
AIR, BEYOND = 1.25, 0.5
# Height of the region above an open box, over its shortest edge.
OPEN = 0.5
# Voxels [finest spacings] in which air is searched.
VOXEL, MOST_VOXELS = 1.0, 300_000
# Half the diagonal of a cube, over its edge.
HALF_DIAGONAL = 0.75**0.5


def m5(r, h):
    """Returns the quartic B-spline M5 [1/m^3] of support h [m]."""
    q = r / h
    a, b, c = (np.maximum(end - q, 0.0) ** 4 for end in (1.0, 0.6, 0.2))
    return 15625.0 / (512.0 * np.pi * h**3) * (a - 5.0 * b + 10.0 * c)


def epanechnikov(r, h):
    """Returns the Epanechnikov kernel [1/m^3] of support h [m]."""
    return 15.0 / (8.0 * np.pi * h**3) * np.maximum(1.0 - (r / h) ** 2, 0.0)


def with_images(x, d, box, reach):
    """Returns positions and spacings with the mirror images within `reach` [m] of the walls."""
    for k in range(3):
        low, high = abs(x[:, k]) < reach, abs(x[:, k] - box[k]) < reach
        below, above = x[low].copy(), x[high].copy()
        below[:, k] *= -1.0
        above[:, k] = 2.0 * box[k] - above[:, k]
        x, d = np.vstack([x, below, above]), np.concatenate([d, d[low], d[high]])
    return x, d


def kernel_density_error(x, d, box):
    """Returns mean and 99th percentile (-) of max(sum V W - 1, 0)."""
    images, spacing = with_images(x, d, box, SUPPORT * d.max())
    total = np.zeros(len(x))
    for a in np.unique(d):
        own, tree = d == a, cKDTree(x[d == a])
        for b in np.unique(d):
            h = SUPPORT * (0.5 * a**EXPONENT + 0.5 * b**EXPONENT) ** (1.0 / EXPONENT)
            pairs = tree.sparse_distance_matrix(
                cKDTree(images[spacing == b]), h, output_type="ndarray"
            )
            total[own] += np.bincount(pairs["i"], b**3 * m5(pairs["v"], h), own.sum())
    excess = np.maximum(total - 1.0, 0.0)
    return excess.mean(), np.percentile(excess, 99.0)


def depth_of_water(x, d, box):
    """Returns the distance [m] of each voxel from air, and the edge of a voxel [m]."""
    edge = max(VOXEL * d.min(), (np.prod(box) / MOST_VOXELS) ** (1.0 / 3.0))
    shape = np.ceil(box / edge).astype(int)
    centres = (np.moveaxis(np.indices(shape), 0, -1) + 0.5) * edge
    wet = np.zeros(shape, bool)
    for a in np.unique(d):
        wet |= cKDTree(x[d == a]).query(centres)[0] < AIR * a
    if wet.all():
        return np.full(shape, np.inf), edge
    return edge * distance_transform_edt(wet), edge


def bulk_density_error(x, d, box, seed=0):
    """Returns the mean over points of sum V W minus 1, the number of points, and the radius of the
    kernel in spacings; NaN if the water is too thin."""
    depth, edge = depth_of_water(x, d, box)
    images, spacing = with_images(x, d, box, WIDE[0] * d.max())
    trees = {a: cKDTree(images[spacing == a]) for a in np.unique(d)}
    for radius in WIDE:
        rng = np.random.default_rng(seed)

        def needed(a, radius=radius):
            return (radius + AIR - BEYOND) * a + 2.0 * HALF_DIAGONAL * edge

        cells = np.argwhere(depth > needed(d.min()))
        if len(cells) * edge**3 < 4.0 / 3.0 * np.pi * (radius * d.min()) ** 3:
            continue
        cells = cells[rng.integers(len(cells), size=POINTS)]
        points, room = (cells + rng.random(cells.shape)) * edge, depth[tuple(cells.T)]
        points, room = points[(points < box).all(1)], room[(points < box).all(1)]
        total, open_ = np.full(len(points), np.nan), np.ones(len(points), bool)
        for a in trees:
            # A kernel of spacing a must not reach into the volume of a coarser particle.
            fits = open_ & (room > needed(a))
            for b in (b for b in trees if b > a):
                fits &= trees[b].query(points)[0] > radius * a + HALF_DIAGONAL * b
            found = np.zeros(fits.sum())
            for b in (b for b in trees if b <= a):
                near = cKDTree(points[fits]).sparse_distance_matrix(
                    trees[b], radius * a, output_type="ndarray"
                )
                weights = b**3 * epanechnikov(near["v"], radius * a)
                found += np.bincount(near["i"], weights, len(found))
            total[fits], open_ = found, open_ & ~fits
        known = total[~np.isnan(total)]
        if len(known) >= ENOUGH * POINTS:
            return known.mean() - 1.0, len(known), radius
    return np.nan, 0, np.nan


def main() -> None:
    parser = argparse.ArgumentParser(description="Density errors of exported particles.")
    parser.add_argument("state", help="a .npz file of msph")
    parser.add_argument("--density", type=float, default=1000.0, help="rest density [kg/m^3]")
    parser.add_argument("--seed", type=int, default=0, help="of the random points")
    given = parser.parse_args()
    with np.load(given.state) as state:
        x, layer = state["x"].astype(float), state["layer"]
        box, mass = state["fluid"][:3].copy(), state["fluid"][3:]
        if "spilt" in state:  # an open box, whose water may rise above the rim
            box[1] += OPEN * box.min()
    d = np.cbrt(mass / given.density)[layer]
    mean, p99 = kernel_density_error(x, d, box)
    bulk, points, radius = bulk_density_error(x, d, box, given.seed)
    print(f"{len(x):,} particles")
    print(f"kernel density error: mean {100 * mean:.3f} %, 99th percentile {100 * p99:.2f} %")
    print(f"bulk density error: {100 * bulk:+.3f} % ({points} kernels of {radius:g} spacings)")


if __name__ == "__main__":
    main()
