"""Upscaling of an image rendered with fewer pixels: cubic convolution (Keys 1981, a = -1/2, weights
of Catmull and Rom), along x, then along y."""

import taichi as ti

from msph.fluid.boundary.sampled_fields import catmull_rom
from msph.picture.room import PixelFields
from msph.picture.samples import CPU_BLOCKS, GPU_BLOCKS
from msph.taichi_internals import data_oriented, kernel, on_cpu

STRIP = 256  # pixels of a column per loop iteration on the CPU, where the inner loop is vectorised


@data_oriented
class Enlarger:
    """Upscales the lower left part of `resolved`."""

    def __init__(self, fields: PixelFields):
        self.wide, self.resolved = fields.wide, fields.resolved
        self.strip, self.block = (STRIP, CPU_BLOCKS) if on_cpu() else (1, GPU_BLOCKS)

    @kernel
    def enlarge(self, columns: ti.i32, rows: ti.i32, width: ti.i32, height: ti.i32):
        """Upscales columns x rows pixels to width x height pixels."""
        strip = self.strip
        ti.loop_config(block_dim=self.block)
        for i, s in ti.ndrange(width, (rows + strip - 1) // strip):
            first, weights = taps(i, columns / width)
            for b in range(s * strip, ti.min((s + 1) * strip, rows)):
                total = ti.math.vec3(0.0)
                for k in ti.static(range(4)):
                    total += weights[k] * self.resolved[ti.math.clamp(first + k, 0, columns - 1), b]
                self.wide[i, b] = total
        ti.loop_config(block_dim=self.block)
        for i, s in ti.ndrange(width, (height + strip - 1) // strip):
            for j in range(s * strip, ti.min((s + 1) * strip, height)):
                first, weights = taps(j, rows / height)
                total = ti.math.vec3(0.0)
                for k in ti.static(range(4)):
                    total += weights[k] * self.wide[i, ti.math.clamp(first + k, 0, rows - 1)]
                self.resolved[i, j] = ti.math.clamp(total, 0.0, 1.0)


@ti.func
def taps(i, scale):
    """Returns the first of the four source pixels of pixel i, and their weights."""
    x = (i + 0.5) * scale - 0.5
    whole = ti.floor(x)
    return ti.cast(whole, ti.i32) - 1, catmull_rom(x - whole)
