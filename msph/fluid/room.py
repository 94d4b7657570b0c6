"""How much a set of fields has room for: classes of capacity, so that scenes share kernels."""

import math
from dataclasses import astuple, dataclass, fields


@dataclass(frozen=True)
class Room:
    """What is allocated once and filled by one scene after another.

    particles; entries of the neighbour list; cells of the neighbour grids, and of the grid on which
    depth is measured; samples, the f32 numbers of meshes' sampled fields.
    """

    particles: int
    entries: int
    cells: int
    depth_cells: int
    samples: int

    def holds(self, needed: "Room") -> bool:
        """Whether there is as much room as needed, of every kind."""
        return all(a >= b for a, b in zip(astuple(self), astuple(needed), strict=True))


# The first class, 40 MiB: every shipped scene fits at every quality (the most are 16,000 particles,
# 1.38 million entries, 39,000 and 26,000 cells, 813,000 samples), so that none compiles anything
# that another has compiled. No power of two: fields a multiple of 4096 bytes apart would compete
# for the same lines of a cache.
FIRST = Room(16_500, 1_425_000, 40_000, 27_000, 820_000)
# Factor from one class to the next, of each kind by itself.
GROWTH = 4
# Most that a class has of a kind unless a scene needs more: indices are 32-bit integers.
MOST = 1 << 29


def room_for(needed: Room) -> Room:
    """The smallest class that holds what is needed."""
    found = {}
    for field in fields(Room):
        first, least = getattr(FIRST, field.name), getattr(needed, field.name)
        steps = max(0, math.ceil(math.log(least / first, GROWTH))) if least else 0
        found[field.name] = max(least, min(first * GROWTH**steps, MOST))
    return Room(**found)
