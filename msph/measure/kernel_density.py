"""Kernel density error: a plain sum of the method's kernel over the particles' positions.

The solver's own density contains a density correction, so its residual measures how well the solver
meets its target. This sum contains positions only, for all methods and other programs alike.
"""

from dataclasses import dataclass

import numpy as np

from msph.fluid.particles.layers import PAIRING
from msph.fluid.projection.solver import Projection
from msph.measure.host_kernels import mirrored, quartic


@dataclass(frozen=True)
class KernelDensity:
    """Kernel density error (-): mean and 99th percentile over particles of max(c - 1, 0)."""

    mean: float
    p99: float


def kernel_sums(x: np.ndarray, spacing: np.ndarray, size: tuple[float, float, float]) -> np.ndarray:
    """Returns c_i = sum_j V_j W(r_ij, h_ij) (-), (n,), with the quartic B-spline M5, over particles
    at x (n, 3) [m] with spacings d (n,) [m], i included, mirrored by the walls of the box `size`
    [m].

    V = d^3, h = 2.45 d, h_ij is the power mean of both supports. Bodies count as air.
    """
    from scipy.spatial import cKDTree  # 0.2 s to import

    support = Projection.SMOOTHING * spacing
    images, which = mirrored(x, size, support.max())
    found, sizes = np.zeros(len(x)), np.unique(spacing)
    own = [np.flatnonzero(spacing == d) for d in sizes]
    others = [np.flatnonzero(spacing[which] == d) for d in sizes]
    trees = [cKDTree(images[ids]) for ids in others]
    for d, ids in zip(sizes, own, strict=True):
        tree = cKDTree(x[ids])
        for other, around in zip(sizes, trees, strict=True):
            h = Projection.SMOOTHING * float(np.mean([d**PAIRING, other**PAIRING])) ** (
                1.0 / PAIRING
            )
            pairs = tree.sparse_distance_matrix(around, h, output_type="ndarray")
            weights = other**3 * quartic(pairs["v"], h)
            found[ids] += np.bincount(pairs["i"], weights, len(ids))
    return found


def kernel_density(
    x: np.ndarray, spacing: np.ndarray, size: tuple[float, float, float]
) -> KernelDensity:
    """Returns the kernel density error of particles; see kernel_sums()."""
    excess = np.maximum(kernel_sums(x, spacing, size) - 1.0, 0.0)
    return KernelDensity(float(excess.mean()), float(np.percentile(excess, 99.0)))
