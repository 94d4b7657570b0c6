"""Exclusive prefix sums of integers, on every backend."""

import taichi as ti

from msph.taichi_internals import data_oriented, kernel, on_cpu

# Chunks that a GPU divides a sum into: one thread adds up their sums, so that a million entries
# take a thousand serial additions there and in each chunk.
CHUNKS = 1024


@data_oriented
class PrefixSum:
    """Prefix sums in one pass on one thread of a CPU, which adds a million numbers in 2 ms, and in
    three on a GPU: sums of chunks, scan of the sums, scan within the chunks.

    Needs no shared memory and no atomics, so it runs the same on CUDA, Vulkan and Metal (Taichi's
    own PrefixSumExecutor knows CUDA and Vulkan only) and its result is deterministic.
    """

    def __init__(self):
        self.serial = on_cpu()
        self.sums = ti.field(ti.i32, shape=CHUNKS)

    @kernel
    def run(self, counts: ti.template(), starts: ti.template(), length: ti.i32):
        """counts (length,) i32 -> starts (length + 1,) i32, starts[0] = 0, starts[-1] = total."""
        self.sum_up(counts, starts, length)

    @ti.func
    def sum_up(self, counts: ti.template(), starts: ti.template(), length):
        """The same within a kernel, at its top level, where its loops are shared out."""
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
        # One thread, whose total stays in a register: a sum read from memory waits for its store.
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
