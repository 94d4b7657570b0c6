"""Pressures before the first step, for which no step has solved yet.

Those of the first steps are no substitute: particles that have not settled carry 20 % less than the
weight of a deep pool. So Poisson's equation for water that starts from rest, div(grad p - f) = 0
with the force f, is solved on a lattice of cells. No water passes walls and bodies, which are held;
p = 0 where the coverage falls below that of a surface. Linear pressures are exact.
"""

import dataclasses
from collections.abc import Callable

import numpy as np

from msph.fluid.external_forces import ExternalForces
from msph.measure.snapshot import SURFACE_COVERAGE, Snapshot

# Largest number of cells: a few seconds in the deepest scene. Cells around the water, in spacings.
MOST_CELLS, AROUND = 4000, 1.5
# Least distance of the surface from the centre of a cell, in cells, and least fall of the coverage
# to the next cell (-): keep the equations finite.
LEAST_DISTANCE, LEAST_FALL = 0.1, 1e-9
# Residual of the solve over its right-hand side.
TOLERANCE = 1e-6

# Function of points (n, 3) [m].
AtPoints = Callable[[np.ndarray], np.ndarray]


def with_first_pressures(
    water: Snapshot, density: float, external: ExternalForces, centre: np.ndarray
) -> Snapshot:
    """Returns the water before the first step with pressures; density [kg/m^3], and external forces
    in a box with this centre [m]."""
    around = AROUND * water.spacing[:, None]
    bounds = (
        np.maximum((water.x - around).min(axis=0), 0.0),
        np.minimum((water.x + around).max(axis=0), water.size),
    )

    def force(points: np.ndarray) -> np.ndarray:
        inertia, _ = external.inertia_at(points - centre, np.zeros_like(points), 0.0)
        return density * (np.array(external.gravity) + inertia)

    lattice = FirstPressure(bounds, water, force)
    return dataclasses.replace(water, pressure=lattice.at(water.x))


class FirstPressure:
    """Lattice of n cells between two corners (3,) [m]. force: returns density times acceleration
    (n, 3) [N/m^3] at points. pressure (n,) [Pa] and slope (n, 3) [Pa/m] are those of the centres
    (n, 3) [m]."""

    def __init__(self, bounds: tuple[np.ndarray, np.ndarray], water: Snapshot, force: AtPoints):
        lo, hi = bounds
        edge = max(water.spacing.min(), float(np.prod(hi - lo) / MOST_CELLS) ** (1.0 / 3.0))
        self.shape = np.maximum(1, np.round((hi - lo) / edge)).astype(int)
        self.edges = (hi - lo) / self.shape
        self.centres = lo + (np.indices(self.shape).reshape(3, -1).T + 0.5) * self.edges
        self.covered, self.force = water.coverages(self.centres), force
        self.wet, self.free = self.covered >= SURFACE_COVERAGE, water.free
        self.faces = [self._faces(axis, side) for axis in range(3) for side in (-1, 1)]
        self.pressure = self._solve()
        self.slope = np.stack([self._slope(axis) for axis in range(3)], axis=1)

    def _faces(self, axis: int, side: int) -> tuple[np.ndarray, ...]:
        """Returns for the faces of all cells at one side: the next cell, whether water or air is
        there, the distance of its pressure in edges, and the force [N/m^3] along the axis."""
        number = np.arange(len(self.wet)).reshape(self.shape)
        after = np.roll(number, -side, axis)
        last = np.moveaxis(np.ones(self.shape, bool), axis, 0)
        last[0 if side < 0 else -1] = False
        within = np.moveaxis(last, 0, axis).ravel()
        after, middle = after.ravel(), self.centres.copy()
        middle[:, axis] += 0.5 * side * self.edges[axis]
        water_or_air = self.wet[after] | self.free(self.centres, 0.0)[after]
        passed = within & self.free(middle, 0.0) & water_or_air
        # The coverage falls linearly to that of the surface.
        fall = np.maximum(self.covered - self.covered[after], LEAST_FALL)
        way = np.clip((self.covered - SURFACE_COVERAGE) / fall, LEAST_DISTANCE, 1.0)
        return after, passed, np.where(self.wet[after], 1.0, way), self.force(middle)[:, axis]

    def _solve(self) -> np.ndarray:
        """Returns the pressures of the cells: for each wet cell, the sum over its faces of the
        outward slope less the outward force is zero."""
        from scipy.sparse import csr_matrix, diags  # 0.1 s to import; only first readings need it
        from scipy.sparse.linalg import cg

        n, inside = len(self.wet), np.flatnonzero(self.wet)
        diagonal, rhs, matrix = np.zeros(n), np.zeros(n), csr_matrix((n, n))
        for k, (after, passed, way, force) in enumerate(self.faces):
            edge, side = self.edges[k // 2], 2 * (k % 2) - 1
            diagonal += passed / (way * edge**2)
            rhs -= passed * side * force / edge
            a = np.flatnonzero(passed & self.wet & self.wet[after])
            matrix += csr_matrix((np.full(len(a), -1.0 / edge**2), (a, after[a])), (n, n))
        matrix = (matrix + diags(diagonal)).tocsr()[inside][:, inside]
        pressure = np.zeros(n)
        pressure[inside] = cg(matrix, rhs[inside], rtol=TOLERANCE)[0]
        return pressure

    def _slope(self, axis: int) -> np.ndarray:
        """Returns the slopes of the pressure along an axis, means of both faces of each cell; on a
        wall the slope balances the force."""
        found = np.zeros(len(self.wet))
        for k, (after, passed, way, force) in list(enumerate(self.faces))[2 * axis : 2 * axis + 2]:
            side = 2 * (k % 2) - 1
            beyond = np.where(self.wet[after], self.pressure[after], 0.0)
            inner = side * (beyond - self.pressure) / (way * self.edges[axis])
            found += 0.5 * np.where(passed, inner, force)
        return found

    def at(self, x: np.ndarray) -> np.ndarray:
        """Returns the pressures (m,) [Pa] at points x (m, 3) [m] in the water."""
        from scipy.spatial import cKDTree

        inside = np.flatnonzero(self.wet)
        cell = inside[cKDTree(self.centres[inside]).query(x)[1]]
        found = self.pressure[cell] + ((x - self.centres[cell]) * self.slope[cell]).sum(axis=1)
        return np.maximum(found, 0.0)
