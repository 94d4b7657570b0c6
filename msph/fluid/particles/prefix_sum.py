"""Exclusive prefix sums of integers, on every backend."""

import taichi as ti

from msph.fluid.particles.particles import FEW_CELLS, one_thread_does
from msph.taichi_internals import data_oriented, kernel

# Entries that one thread adds up serially: long enough to hide a thread's start, short enough to
# leave a GPU something to share out.
CHUNK = 256


@data_oriented
class PrefixSum:
    """Prefix sums in one pass on one thread where they are short, else in three: sums of chunks,
    scan of the sums, scan within the chunks.

    Needs no shared memory and no atomics, so it runs the same on CPU, CUDA, Vulkan and Metal
    (Taichi's own PrefixSumExecutor knows CUDA and Vulkan only) and its result is deterministic.
    """

    def __init__(self, length: int):
        self.length = length
        self.chunks = (length + CHUNK - 1) // CHUNK
        self.few = one_thread_does(length, FEW_CELLS)
        self.sums = ti.field(ti.i32, shape=self.chunks)

    @kernel
    def run(self, counts: ti.template(), starts: ti.template()):
        """counts (length,) i32 -> starts (length + 1,) i32, starts[0] = 0, starts[-1] = total."""
        self.sum_up(counts, starts)

    @ti.func
    def sum_up(self, counts: ti.template(), starts: ti.template()):
        """The same within a kernel, at its top level, where its loops are shared out."""
        if ti.static(self.few):
            starts[0] = 0
            ti.loop_config(serialize=True)
            for i in range(self.length):
                starts[i + 1] = starts[i] + counts[i]
        else:
            self._sum_up_in_chunks(counts, starts)

    @ti.func
    def _sum_up_in_chunks(self, counts: ti.template(), starts: ti.template()):
        for c in range(self.chunks):
            total = 0
            for i in range(c * CHUNK, ti.min((c + 1) * CHUNK, self.length)):
                total += counts[i]
            self.sums[c] = total
        ti.loop_config(serialize=True)
        for c in range(1, self.chunks):
            self.sums[c] += self.sums[c - 1]
        for c in range(self.chunks):
            total = 0
            if c > 0:
                total = self.sums[c - 1]
            for i in range(c * CHUNK, ti.min((c + 1) * CHUNK, self.length)):
                starts[i] = total
                total += counts[i]
            if c == self.chunks - 1:
                starts[self.length] = total
