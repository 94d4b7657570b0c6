"""Sums over all particles, to which every particle adds in every step."""

import taichi as ti

from msph.launches import data_oriented
from msph.taichi_internals import longest_float, on_cpu

# Partial sums on a GPU. Taichi ends a loop that adds to one number with an addition by each of the
# loop's threads (launches.BLOCKS), whatever the number of particles: 5 ms on an H100 in
# double precision with Taichi's own number of threads.
SLOTS = 1024


@data_oriented
class Sum:
    """A sum of numbers, or of vectors of three components. total: field of shape (), complete after
    gather() of all slots. On a CPU, particles add to it directly.

    Sums have double precision where the device supports it: in single precision the sums of still
    water drifted by 2.6e-5 of the largest sum m |v| in 2 s, 20 times the drift in double precision.
    """

    def __init__(self, vector: bool = False):
        number, self.vector = longest_float(), vector
        self.total, self.parts = (
            ti.Vector.field(3, number, shape=shape) if vector else ti.field(number, shape=shape)
            for shape in ((), SLOTS)
        )
        self.direct = on_cpu()

    @ti.func
    def add(self, i, value):
        """Adds the value of particle i."""
        if ti.static(self.direct):
            self.total[None] += value
        else:
            self.parts[i % SLOTS] += value

    @ti.func
    def gather(self, slot):
        """Adds a partial sum to the total."""
        self.total[None] += self.parts[slot]
        self.parts[slot] *= 0.0
