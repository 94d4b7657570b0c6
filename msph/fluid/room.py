"""Capacity classes: scenes of one class share fields and compiled kernels."""

from dataclasses import astuple, dataclass


@dataclass(frozen=True)
class Room:
    """Capacity of the fluid's fields.

    particles: number of particles. entries: of the neighbour list. cells: of the neighbour grids of
    all layers. depth_cells: of the depth grid. samples: f32 values of the meshes' sampled fields.
    images: of particles in walls and bodies.
    """

    particles: int
    entries: int
    cells: int
    depth_cells: int
    samples: int
    images: int

    def holds(self, needed: "Room") -> bool:
        """Returns True if no capacity is less than needed."""
        return all(a >= b for a, b in zip(astuple(self), astuple(needed), strict=True))


# Smallest class, about 90 MiB: every shipped scene fits at every quality. The sizes are no powers
# of two: fields a multiple of 4096 bytes apart would compete for the same cache lines.
FIRST = Room(16_500, 1_425_000, 45_000, 30_000, 820_000, 1_000_000)
# Largest number of bodies: 64 of a scene, and a container.
MAX_BODIES = 65
# Factor between classes, applied to each capacity separately since Taichi touches all it allocates.
GROWTH = 2
# Largest capacity of a class, unless a scene needs more: indices are 32-bit integers.
MAX_SIZE = 1 << 29


def room_for(needed: Room) -> Room:
    """Returns the smallest class with at least the needed capacity."""
    return Room(*(grown(*pair) for pair in zip(astuple(FIRST), astuple(needed), strict=True)))


def grown(first: int, needed: int) -> int:
    """Returns `first` times a sufficient power of GROWTH, or `needed` beyond MAX_SIZE."""
    size = first
    while size < needed:
        size = size * GROWTH if size * GROWTH <= MAX_SIZE else needed
    return size
