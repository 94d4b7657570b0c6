"""Classes of capacity: scenes of one class share fields, and so their compiled kernels."""

from dataclasses import astuple, dataclass


@dataclass(frozen=True)
class Room:
    """Capacity of the fluid's fields, which are allocated once and refilled for each scene.

    particles: number of particles. entries: of the neighbour list. cells: of the neighbour grids of
    all layers. depth_cells: of the grid on which depth is measured. samples: f32 numbers of the
    sampled fields of meshes.
    """

    particles: int
    entries: int
    cells: int
    depth_cells: int
    samples: int

    def holds(self, needed: "Room") -> bool:
        """Returns True if every kind has at least the capacity needed."""
        return all(a >= b for a, b in zip(astuple(self), astuple(needed), strict=True))


# The first class, 40 MiB: every shipped scene fits at every quality (the most are 16,000 particles,
# 1.38 million entries, 39,000 and 26,000 cells, 813,000 samples), so that none compiles anything
# that another has compiled. No power of two: fields a multiple of 4096 bytes apart would compete
# for the same lines of a cache.
FIRST = Room(16_500, 1_425_000, 40_000, 27_000, 820_000)
# Factor from one class to the next, of each kind by itself: Taichi touches all that it allocates.
GROWTH = 2
# Most that a class has of a kind unless a scene needs more: indices are 32-bit integers.
MAX_SIZE = 1 << 29


def room_for(needed: Room) -> Room:
    """The smallest class that holds what is needed."""
    return Room(*(grown(*pair) for pair in zip(astuple(FIRST), astuple(needed), strict=True)))


def grown(first: int, needed: int) -> int:
    """`first` times the power of GROWTH that holds `needed`; `needed` itself beyond MAX_SIZE."""
    found = first
    while found < needed:
        found = found * GROWTH if found * GROWTH <= MAX_SIZE else needed
    return found
