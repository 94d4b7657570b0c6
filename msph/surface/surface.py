"""Surface of the water from the particles: band, coverage, marching cubes, drops, rounding."""

import math

import numpy as np
import taichi as ti

from msph.fluid.boundary.boundary import Boundary
from msph.launches import data_oriented, heavy_kernel
from msph.state import State
from msph.surface.band import Band, band_numbers
from msph.surface.bodies import Bodies
from msph.surface.drops import Drops
from msph.surface.fluid_fraction import ISO, SLOPE
from msph.surface.lattice import PAIR, RUN, Lattice
from msph.surface.marching_cubes import NO_CUT, MarchingCubes
from msph.surface.room import SurfaceRoom
from msph.surface.rounding import Rounding
from msph.surface.sums import HALF_TILE, TILE, KernelSums
from msph.surface.thin_water import ThinWater
from msph.surface.water_volume import WaterVolume


def surface_of(state: State, room: SurfaceRoom) -> "Surface":
    """Builds a surface of the particles of a state (for State.build_once)."""
    return Surface(state.layers, state.grid, state.particles, state.boundary, room)


@data_oriented
class Surface:
    """Closed triangle mesh of the water in a box, flat along its walls.

    Built once and loaded with one scene after another: memory and compiled kernels serve all scenes
    that fit in `room`. boundary: the fluid's bodies, on which the surface ends.
    """

    def __init__(self, layers, grid, particles, boundary: Boundary | None, room: SurfaceRoom):
        self.room = room
        self.layers, self.grid, self.boundary = layers, grid, boundary
        self.particles = particles
        self.cubes = MarchingCubes(room)
        self.mesh = self.cubes.mesh
        bodies = Bodies(boundary, self.cubes.numbers)
        self.thin = ThinWater(layers, grid, particles, bodies, room)
        self.sums = KernelSums(self.cubes.lattice, self.thin, room)
        self.band = Band(self.cubes.signs, self.sums, room)
        self.volume_control = WaterVolume(self.cubes, self.thin)
        self.drops = Drops(self.mesh, self.thin)
        self.rounding = Rounding(self.mesh, self.drops, bodies, room)

    def load(self, size: tuple[float, float, float], cell: float, smoothing: float = 1.0) -> None:
        """Loads a scene: its box, the fluid's layers, and the number of bodies.

        size (Lx, Ly, Lz) [m], with the minimum corner at the origin; cell: requested lattice
        spacing [m]; smoothing: kernel radius over the layer's support h, >= 1. Raises ValueError
        for smoothing below 1, cells too coarse for the kernels, or a scene that exceeds the room.
        """
        if smoothing < 1.0:
            raise ValueError(f"surface smoothing is {smoothing}, must be at least 1")
        lattice, specs = Lattice.in_box(size, cell), self.layers.specs
        radii = smoothing * np.array([s.support for s in specs])
        bodies = self.boundary.count if self.boundary else 0
        thinnest = self.boundary.thinnest if self.boundary else math.inf
        band = band_numbers(lattice.spacing, radii.min(), bodies > 0, thinnest)
        self.room.check(lattice, len(specs), self.particles.capacity)
        self.lattice, self.has_bodies = lattice, bodies > 0
        # Slope of coverage at a plane, SLOPE/r; where kernels differ, of the finest layer.
        slope = SLOPE / (smoothing * self.layers.finest.support)
        self.cubes.lattice.load(
            lattice,
            size=size,
            layers=len(specs),
            bodies=bodies,
            widest=radii.max(),
            slope=slope,
            **band,
        )
        self.overlap = band["overlap"] * slope
        self.thin.load(specs, radii)
        self.sums.load(lattice, size, radii)
        self.rounding.load(max(lattice.spacing))

    def shortfall(self) -> str | None:
        """Returns a message if the last mesh may lack volume of the water, otherwise None."""
        return self.mesh.overflowed() or self.volume_control.limit_reached()

    def reset(self) -> None:
        """Forgets the spray."""
        self.thin.spray.reset()

    def advance(self, dt: float) -> None:
        """Adds dt [s] to the time by which spray changes at the next extract()."""
        self.thin.spray.elapsed += dt

    def extract(self, for_image: bool = False) -> None:
        """Computes the mesh from the particles in thirteen kernel launches, besides the sort.

        for_image: the mesh lacks the spray (spray.py), and ends inside opaque bodies (band.py). The
        waterline is then the intersection of both surfaces, exact to a pixel; at the end of the
        mesh it would have steps of a cell.
        """
        self.grid.refresh()
        hidden = for_image and self.has_bodies
        frame, dt = self.thin.spray.next_frame()
        self.band.sample(self.has_bodies)
        self.band.classify(self.has_bodies)
        self.band.include_thin(self.particles.count, self.has_bodies, frame, dt, int(for_image))
        self.evaluate(self.has_bodies)
        self.volume_control.make_mesh(self.overlap if hidden else 0.0)
        self.drops.add()
        self.rounding.round(self.has_bodies)

    @heavy_kernel
    def evaluate(self, bodies: ti.template()):
        """Computes f = c - iso (sums.py), its gradient, and the cut of bodies at the nodes of the
        band."""
        for q in range(self.band.count[None]):
            first = self.band.tile(q)
            i, j = first[0] + ti.Vector([0, 1]), first[1] + ti.Vector([0, 1])
            k = first[2] + ti.Vector([0, 1, 2, 3])
            c, gx, gy, gz, near_body = self.sums.sum_tile(i, j, k, bodies, False)
            for n in range(TILE):
                node = first + ti.Vector([n // HALF_TILE, n // RUN % PAIR, n % RUN])
                at = self.cubes.lattice.node_index(node)
                self.cubes.value[at], self.cubes.cut[at] = c[n] - ISO, NO_CUT
                self.cubes.gradient[at] = ti.math.vec3(gx[n], gy[n], gz[n])
                if ti.static(bodies):
                    if near_body:
                        cut = self.sums.bodies.cut(self.cubes.lattice.point(node))
                        self.cubes.cut[at], self.cubes.cut_gradient[at] = cut[0], cut.yzw
