"""A picture drawn at fewer pixels, enlarged sharply to its full size.

Catmull and Rom's cubic convolution (Keys 1981, a = -1/2) along x, then along y: of the four pixels
round a place at the fraction t after the second the weights are
    (-t + 2 t^2 - t^3)/2,  (2 - 5 t^2 + 3 t^3)/2,  (t + 4 t^2 - 3 t^3)/2,  (-t^2 + t^3)/2,
which keep edges sharper than linear means do.
"""

import taichi as ti

from msph.taichi_internals import data_oriented, kernel


@data_oriented
class Enlarger:
    """From the lower left part of `canvas` to all of `image`, 3-vec fields (width, height), index
    [right, up]."""

    def __init__(self, canvas, width: int, height: int):
        self.canvas, self.width, self.height = canvas, width, height
        self.image = ti.Vector.field(3, ti.f32, (width, height))
        self.wide = ti.Vector.field(3, ti.f32, (width, height))  # enlarged along x

    @kernel
    def enlarge(self, columns: ti.i32, rows: ti.i32):
        """The canvas's first columns x rows pixels fill the image."""
        ti.loop_config(block_dim=1)
        for i in range(self.width):
            first, weights = taps(i, columns / self.width)
            for b in range(rows):
                total = ti.math.vec3(0.0)
                for k in ti.static(range(4)):
                    a = ti.math.clamp(first + k, 0, columns - 1)
                    total += weights[k] * self.canvas[a, b]
                self.wide[i, b] = total
        ti.loop_config(block_dim=1)
        for i in range(self.width):
            for j in range(self.height):
                first, weights = taps(j, rows / self.height)
                total = ti.math.vec3(0.0)
                for k in ti.static(range(4)):
                    b = ti.math.clamp(first + k, 0, rows - 1)
                    total += weights[k] * self.wide[i, b]
                self.image[i, j] = ti.math.clamp(total, 0.0, 1.0)


@ti.func
def taps(i, scale):
    """The first of the four pixels round the place of pixel i in a picture `scale` times as large,
    and their weights."""
    x = (i + 0.5) * scale - 0.5
    whole = ti.floor(x)
    t = x - whole
    weights = 0.5 * ti.math.vec4(
        t * (-1.0 + t * (2.0 - t)),
        2.0 + t * t * (3.0 * t - 5.0),
        t * (1.0 + t * (4.0 - 3.0 * t)),
        t * t * (t - 1.0),
    )
    return ti.cast(whole, ti.i32) - 1, weights
