"""A picture drawn at fewer pixels, enlarged sharply to its full size: cubic convolution (Keys 1981,
a = -1/2) with the weights of Catmull and Rom, along x, then along y."""

import taichi as ti

from msph.fluid.boundary.sampled_fields import catmull_rom
from msph.picture.rasteriser import BLOCK
from msph.picture.room import PixelFields
from msph.taichi_internals import data_oriented, kernel


@data_oriented
class Enlarger:
    """From the lower left part of `canvas` to `resolved`."""

    def __init__(self, fields: PixelFields):
        self.canvas, self.wide, self.resolved = fields.canvas, fields.wide, fields.resolved

    @kernel
    def enlarge(self, columns: ti.i32, rows: ti.i32, width: ti.i32, height: ti.i32):
        """The canvas's first columns x rows pixels fill the first width x height resolved ones."""
        ti.loop_config(block_dim=BLOCK)
        for i, b in ti.ndrange(width, rows):
            first, weights = taps(i, columns / width)
            total = ti.math.vec3(0.0)
            for k in ti.static(range(4)):
                total += weights[k] * self.canvas[ti.math.clamp(first + k, 0, columns - 1), b]
            self.wide[i, b] = total
        ti.loop_config(block_dim=BLOCK)
        for i, j in ti.ndrange(width, height):
            first, weights = taps(j, rows / height)
            total = ti.math.vec3(0.0)
            for k in ti.static(range(4)):
                total += weights[k] * self.wide[i, ti.math.clamp(first + k, 0, rows - 1)]
            self.resolved[i, j] = ti.math.clamp(total, 0.0, 1.0)


@ti.func
def taps(i, scale):
    """The first of the four pixels round the place of pixel i in a picture `scale` times as large,
    and their weights."""
    x = (i + 0.5) * scale - 0.5
    whole = ti.floor(x)
    return ti.cast(whole, ti.i32) - 1, catmull_rom(x - whole)
