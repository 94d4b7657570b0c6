"""Capacity of the surface: what is allocated once, for any scene that fits."""

import math
from dataclasses import astuple, dataclass

from msph.fluid.room import grown
from msph.surface.lattice import Lattice

# Layers for which tables have rows.
LAYERS = 16
# Vertices per lattice face of the box's hull: 1 for the walls and still water, the rest for waves,
# drops and bubbles.
VERTICES_PER_HULL_FACE = 2.5
# A closed mesh has two triangles per vertex (Euler), a few less or more for its topology.
TRIANGLES_PER_VERTEX = 2.1
# Numbers of 4 bytes per node in all arrays over nodes, words, sub-blocks and tiles; per node of an
# axis; per vertex, per triangle and per particle.
NUMBERS = (8, 3 * (2 * LAYERS + 1), 6, 3, 2)


@dataclass(frozen=True)
class SurfaceRoom:
    """Numbers of things that a Surface has memory for. The defaults are the first class, which
    holds every shipped scene at every quality.

    nodes: of the lattice, padded; axis: nodes along its longest axis, padded.
    """

    nodes: int = 330_000
    axis: int = 1_024
    vertices: int = 100_000
    triangles: int = 210_000
    particles: int = 16_500

    @classmethod
    def needed(cls, lattice: Lattice, particles: int) -> "SurfaceRoom":
        """What a lattice, a mesh as large as waves and splashes make it, and `particles` need."""
        nx, ny, nz = lattice.shape
        vertices = math.ceil(VERTICES_PER_HULL_FACE * 2 * (nx * ny + ny * nz + nz * nx))
        triangles = math.ceil(TRIANGLES_PER_VERTEX * vertices)
        nodes, axis = math.prod(lattice.padded), max(lattice.padded)
        return cls(nodes, axis, vertices, triangles, particles)

    @classmethod
    def holding(
        cls, size: tuple[float, float, float], cell: float, particles: int
    ) -> "SurfaceRoom":
        """The class for a box of `size` [m] with cells of `cell` [m]: of each kind the first
        class, times a power of GROWTH where more is needed."""
        needed = astuple(cls.needed(Lattice.in_box(size, cell), particles))
        return cls(*(grown(*pair) for pair in zip(astuple(cls()), needed, strict=True)))

    def check(self, lattice: Lattice, layers: int, particles: int) -> None:
        """Raises ValueError unless the lattice, the layers and the particles fit."""
        needed = self.needed(lattice, particles)
        wanted = {name: getattr(needed, name) for name in ("nodes", "axis", "particles")}
        for name, n in (*wanted.items(), ("layers", layers)):
            most = getattr(self, name, LAYERS)
            if n > most:
                raise ValueError(f"the surface has room for {most:,} {name}, not for {n:,}")

    @property
    def bytes(self) -> int:
        """Device memory [bytes]."""
        return 4 * sum(n * k for n, k in zip(astuple(self), NUMBERS, strict=True))
