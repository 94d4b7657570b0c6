"""Capacity of the surface: memory allocated once for all scenes that fit."""

import math
from dataclasses import astuple, dataclass

from msph.fluid.room import grown
from msph.surface.lattice import Lattice

LAYERS = 16  # rows of the tables by layer
# Vertices per lattice face on the sides of the box: 1 for walls and still water, the rest for
# waves, drops and bubbles.
VERTICES_PER_HULL_FACE = 2.5
# A closed mesh has two triangles per vertex (Euler), slightly more or less by its topology.
TRIANGLES_PER_VERTEX = 2.1
# Values of 4 bytes per node (nodes, words, sub-blocks and tiles), per node of an axis, per vertex,
# per triangle and per particle.
VALUES = (11, 3 * (2 * LAYERS + 1), 14, 4, 14)


@dataclass(frozen=True)
class SurfaceRoom:
    """Capacity of a Surface. The defaults are the first class, for every shipped scene and quality.

    nodes: of the padded lattice; axis: nodes along its longest padded axis.
    """

    nodes: int = 330_000
    axis: int = 1_024
    vertices: int = 100_000
    triangles: int = 210_000
    particles: int = 16_500

    @classmethod
    def needed(cls, lattice: Lattice, particles: int) -> "SurfaceRoom":
        """Returns the capacity for a lattice, `particles`, and a mesh with waves and splashes."""
        nx, ny, nz = lattice.shape
        vertices = math.ceil(VERTICES_PER_HULL_FACE * 2 * (nx * ny + ny * nz + nz * nx))
        triangles = math.ceil(TRIANGLES_PER_VERTEX * vertices)
        nodes, axis = math.prod(lattice.padded), max(lattice.padded)
        return cls(nodes, axis, vertices, triangles, particles)

    @classmethod
    def holding(
        cls, size: tuple[float, float, float], cell: float, particles: int
    ) -> "SurfaceRoom":
        """Returns the class for a box of `size` [m] with cells of `cell` [m]: each capacity of the
        first class, times a power of GROWTH if needed."""
        needed = astuple(cls.needed(Lattice.in_box(size, cell), particles))
        return cls(*(grown(*pair) for pair in zip(astuple(cls()), needed, strict=True)))

    def check(self, lattice: Lattice, layers: int, particles: int) -> None:
        """Raises ValueError if the lattice, the layers or the particles do not fit."""
        needed = {"nodes": math.prod(lattice.padded), "axis": max(lattice.padded)}
        for name, n in {**needed, "particles": particles, "layers": layers}.items():
            most = getattr(self, name, LAYERS)
            if n > most:
                raise ValueError(f"the surface has room for {most:,} {name}, not for {n:,}")

    @property
    def bytes(self) -> int:
        """Device memory [bytes]."""
        return 4 * sum(n * k for n, k in zip(astuple(self), VALUES, strict=True))
