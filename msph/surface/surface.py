"""The water's surface from the particles, once per frame: band, coverage, marching cubes."""

import math

from msph.fluid.boundary.boundary import Boundary
from msph.surface.band import Band
from msph.surface.bodies import Bodies
from msph.surface.coverage import Coverage
from msph.surface.fluid_fraction import SLOPE
from msph.surface.lattice import Lattice
from msph.surface.marching_cubes import MarchingCubes
from msph.surface.mesh import SurfaceMesh
from msph.surface.sums import KernelSums
from msph.surface.thin_water import ThinWater
from msph.surface.water_volume import WaterVolume

# Lattice faces of the box's hull times this are the vertices provided for: 1 for the walls and
# still water, the rest for waves, drops and bubbles.
VERTICES_PER_HULL_FACE = 2.5
# A closed mesh has two triangles per vertex (Euler), a few less or more for its topology.
TRIANGLES_PER_VERTEX = 2.1


def mesh_capacity(shape: tuple[int, int, int]) -> tuple[int, int]:
    """Vertices and triangles provided for a lattice of `shape` nodes."""
    nx, ny, nz = shape
    hull = 2 * (nx * ny + ny * nz + nz * nx)
    vertices = math.ceil(VERTICES_PER_HULL_FACE * hull)
    return vertices, math.ceil(TRIANGLES_PER_VERTEX * vertices)


class Surface:
    """Closed triangle mesh of the water in a box, its walls flat.

    size (Lx, Ly, Lz) [m], min corner the origin; cell: wanted spacing of the surface lattice [m];
    smoothing: kernel radius over the layer's support h, >= 1.
    boundary: the bodies, on which the surface ends. The grid must be sorted (grid.build) before
    extract().
    """

    def __init__(
        self,
        size: tuple[float, float, float],
        layers,
        grid,
        particles,
        *,
        cell: float,
        smoothing: float = 1.0,
        boundary: Boundary | None = None,
        max_vertices: int | None = None,
        max_triangles: int | None = None,
    ):
        if smoothing < 1.0:
            raise ValueError(f"surface smoothing is {smoothing}, must be at least 1")
        lattice = Lattice.in_box(size, cell)
        default = mesh_capacity(lattice.shape)
        self.lattice = lattice
        self.mesh = SurfaceMesh(max_vertices or default[0], max_triangles or default[1])
        # Beside a plane coverage falls by SLOPE/r; where kernels differ, as in the finest layer.
        slope = SLOPE / (smoothing * layers.finest.support)
        bodies = Bodies(boundary, slope) if boundary is not None and boundary.count else None
        self.cubes = MarchingCubes(lattice, self.mesh, bodies is not None)
        thin = ThinWater(size, layers, grid, particles, bodies, smoothing)
        sums = KernelSums(lattice, size, layers, grid, thin, bodies)
        self.coverage = Coverage(self.cubes, sums)
        self.water = WaterVolume(self.cubes, thin)

    @staticmethod
    def bytes_needed(
        size: tuple[float, float, float], cell: float, particles: int, bodies: bool
    ) -> int:
        """Device memory of a Surface with default capacities, before allocating it [bytes], for so
        many particles, with bodies in the water or without.

        Tables per layer and axis, a few kilobytes, are not counted.
        """
        shape = Lattice.shape_in_box(size, cell)
        return (
            Band.bytes_needed(shape)
            + MarchingCubes.bytes_needed(shape, bodies)
            + SurfaceMesh.bytes_needed(*mesh_capacity(shape))
            + ThinWater.bytes_needed(particles)
        )

    def shortfall(self) -> str | None:
        """Why the last mesh may lack volume of the water, in words; None where nothing was cut."""
        return self.mesh.overflowed() or self.water.limited()

    def extract(self, everywhere: bool = False) -> None:
        """particles -> mesh: seven launches, nothing read back.

        everywhere: evaluate all of the box, for comparison. It gives the same mesh.
        """
        self.coverage.run(everywhere)
        self.water.set_right()
        self.cubes.run()
