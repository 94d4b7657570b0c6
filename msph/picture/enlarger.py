"""Upscaling of an image rendered with fewer pixels: cubic convolution (Keys 1981, a = -1/2, weights
of Catmull and Rom), along y, then along x."""

import taichi as ti

from msph.fluid.boundary.sampled_fields import catmull_rom
from msph.launches import data_oriented, kernel
from msph.picture.room import PixelFields
from msph.picture.samples import CPU_BLOCKS, GPU_BLOCKS, strip_length, strips
from msph.taichi_internals import on_cpu


@data_oriented
class Enlarger:
    """Upscales the lower left part of `resolved`."""

    def __init__(self, fields: PixelFields):
        self.high, self.resolved = fields.high, fields.resolved
        self.strip, self.block = strip_length(), CPU_BLOCKS if on_cpu() else GPU_BLOCKS
        # First source pixel and weights of each row of the image, equal in all columns.
        self.first = ti.field(ti.i32, fields.room.height)
        self.weights = ti.Vector.field(4, ti.f32, fields.room.height)

    @kernel
    def enlarge(self, columns: ti.i32, rows: ti.i32, width: ti.i32, height: ti.i32):
        """Upscales columns x rows pixels to width x height pixels. Along y first: this pass costs
        more per pixel, and only the rendered columns need it."""
        strip = self.strip
        for j in range(height):
            self.first[j], self.weights[j] = taps(j, rows / height)
        ti.loop_config(block_dim=self.block)
        for i, s in ti.ndrange(columns, strips(height, strip)):
            for j in range(s * strip, ti.min((s + 1) * strip, height)):
                first, weights, total = self.first[j], self.weights[j], ti.math.vec3(0.0)
                for k in ti.static(range(4)):
                    total += weights[k] * self.resolved[i, ti.math.clamp(first + k, 0, rows - 1)]
                self.high[i, j] = total
        ti.loop_config(block_dim=self.block)
        for i, s in ti.ndrange(width, strips(height, strip)):
            first, weights = taps(i, columns / width)
            source = ti.math.clamp(first + ti.Vector([0, 1, 2, 3]), 0, columns - 1)
            for j in range(s * strip, ti.min((s + 1) * strip, height)):
                total = ti.math.vec3(0.0)
                for k in ti.static(range(4)):
                    total += weights[k] * self.high[source[k], j]
                self.resolved[i, j] = ti.math.clamp(total, 0.0, 1.0)


@ti.func
def taps(i, scale):
    """Returns the first of the four source pixels of pixel i, and their weights."""
    x = (i + 0.5) * scale - 0.5
    whole = ti.floor(x)
    return ti.cast(whole, ti.i32) - 1, catmull_rom(x - whole)
