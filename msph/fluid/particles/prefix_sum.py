"""Exclusive prefix sums of integers on every backend."""

import taichi as ti

from msph.launches import data_oriented, kernel
from msph.taichi_internals import on_cpu

# Chunks of a sum on a GPU: a million entries take a thousand serial additions per chunk, and a
# thousand more on one thread for the chunks' sums.
CHUNKS = 1024


@data_oriented
class PrefixSum:
    """Prefix sum in one serial pass on a CPU (2 ms for a million numbers), in three passes on a
    GPU: sums of chunks, scan of the sums, scan within the chunks.

    Uses neither shared memory nor atomics, so that it is deterministic and runs on CUDA, Vulkan and
    Metal (Taichi's PrefixSumExecutor supports CUDA and Vulkan only).
    """

    def __init__(self):
        self.serial = on_cpu()
        self.sums = ti.field(ti.i32, shape=CHUNKS)

    @kernel
    def run(self, counts: ti.template(), starts: ti.template(), length: ti.i32):
        """Writes sums of counts (length,) i32 to starts (length + 1,) i32, from 0 to the total."""
        self.sum_up(counts, starts, length)

    @ti.func
    def sum_up(self, counts: ti.template(), starts: ti.template(), length):
        """Does what run() does, at the top level of a kernel, where its loops are parallel."""
        if ti.static(self.serial):
            ti.loop_config(serialize=True)
            for i in range(length):
                if i == 0:
                    starts[0] = 0
                starts[i + 1] = starts[i] + counts[i]
        else:
            self._sum_up_in_chunks(counts, starts, length)

    @ti.func
    def _sum_up_in_chunks(self, counts: ti.template(), starts: ti.template(), length):
        for c in range(CHUNKS):
            size = (length + CHUNKS - 1) // CHUNKS
            total = 0
            for i in range(c * size, ti.min((c + 1) * size, length)):
                total += counts[i]
            self.sums[c] = total
        # One thread keeps the total in a register: a sum read from memory would wait for its store.
        ti.loop_config(serialize=True)
        for _ in range(1):
            before = 0
            for c in range(CHUNKS):
                before += self.sums[c]
                self.sums[c] = before
        for c in range(CHUNKS):
            size = (length + CHUNKS - 1) // CHUNKS
            total = 0
            if c > 0:
                total = self.sums[c - 1]
            for i in range(c * size, ti.min((c + 1) * size, length)):
                starts[i] = total
                total += counts[i]
            if c == CHUNKS - 1:
                starts[length] = total
