"""Smoothing of edges in an image of one ray per pixel: FXAA (Lottes 2009), which blends the pixels
of an edge along its direction. Green represents brightness, to which it contributes most.

Only blocks of pixels with edges and their neighbours are smoothed: elsewhere samples vary slowly
between rays, and the joints of tiles are antialiased by their own filter."""

import taichi as ti

from msph.launches import data_oriented, heavy_kernel
from msph.picture.pixels import colour_of, green_of
from msph.picture.room import PixelFields
from msph.picture.samples import CPU_BLOCKS, EVEN, GPU_BLOCKS, SPAN, STATES, UNEVEN, blocks
from msph.taichi_internals import on_cpu

vec2 = ti.math.vec2

GREEN = 1  # index of the colour
# Contrast with the four neighbours above which a pixel belongs to an edge: absolute, and over the
# brightest of the five pixels.
LEAST_CONTRAST, CONTRAST = 0.04, 0.1
# Length along an edge over which pixels are blended [pixels], and terms that keep its direction
# finite where an edge is weak: over the mean brightness, and absolute.
LENGTH, DAMPING, LEAST_DAMPING = 6.0, 0.125, 1.0 / 128.0


@data_oriented
class EdgeFilter:
    """Writes the canvas with smooth edges to `resolved`."""

    def __init__(self, fields: PixelFields):
        self.canvas, self.resolved = fields.canvas, fields.resolved
        self.state, self.rough = fields.samples.state, fields.rough
        self.block = CPU_BLOCKS if on_cpu() else GPU_BLOCKS

    @heavy_kernel
    def smooth(self, columns: ti.i32, rows: ti.i32, whole: ti.i32):
        """Smooths columns x rows pixels; whole: 1 if any block may have edges, as the states of
        blocks are of another image."""
        ti.loop_config(block_dim=self.block)
        for a, b in ti.ndrange(blocks(columns), blocks(rows)):
            edges = ti.max(whole, self.has_edges(a, b))
            for i in range(a * SPAN, ti.min((a + 1) * SPAN, columns)):
                if edges == 1:
                    for j in range(b * SPAN, ti.min((b + 1) * SPAN, rows)):
                        self.resolved[i, j] = self.smoothed(i, j, columns, rows)
                else:
                    for j in range(b * SPAN, ti.min((b + 1) * SPAN, rows)):
                        self.resolved[i, j] = colour_of(self.canvas[i, j])

    @ti.func
    def has_edges(self, a, b):
        """Returns 1 if a block or one of its four neighbours is uneven, or shows an uneven block of
        the image without water, or if water ends between them. In front of even water only bodies
        are visible, and edge lines, which are antialiased."""
        found, wet = 0, self.state[a, b] % STATES == EVEN
        for k in range(5):
            c = a + ti.select(k == 1, -1, 0) + ti.select(k == 2, 1, 0)
            d = b + ti.select(k == 3, -1, 0) + ti.select(k == 4, 1, 0)
            if c >= 0 and d >= 0 and c < self.rough.shape[0] and d < self.rough.shape[1]:
                state, rough = self.state[c, d] % STATES, self.rough[c, d]
                if state == UNEVEN or (state == EVEN) != wet:
                    found = 1
                if rough > 0 and not wet:
                    found = 1
        return found

    @ti.func
    def smoothed(self, i, j, columns, rows):
        """Returns the colour of a pixel, blended along the edge if it belongs to one."""
        own = colour_of(self.canvas[i, j])
        west, east = ti.max(i - 1, 0), ti.min(i + 1, columns - 1)
        south, north = ti.max(j - 1, 0), ti.min(j + 1, rows - 1)
        a, b = self.green(west, j), self.green(east, j)
        c, d = self.green(i, south), self.green(i, north)
        least, most = ti.min(own[GREEN], a, b, c, d), ti.max(own[GREEN], a, b, c, d)
        if most - least > ti.max(LEAST_CONTRAST, CONTRAST * most):
            along = self.direction(west, east, south, north)
            last = ti.Vector([columns - 1, rows - 1])
            own = self.blend(vec2(i, j), along, least, most, last)
        return own

    @ti.func
    def green(self, i, j):
        return green_of(self.canvas[i, j])

    @ti.func
    def direction(self, west, east, south, north):
        """Returns the way [pixels] along the edge through a pixel, from its diagonal neighbours."""
        sw, se = self.green(west, south), self.green(east, south)
        nw, ne = self.green(west, north), self.green(east, north)
        along = vec2((sw + se) - (nw + ne), (ne + se) - (nw + sw))
        damping = ti.max(0.25 * DAMPING * (sw + se + nw + ne), LEAST_DAMPING)
        steepest = ti.min(abs(along.x), abs(along.y)) + damping
        return ti.math.clamp(along / steepest, -LENGTH, LENGTH)

    @ti.func
    def blend(self, place, along, least, most, last):
        """Returns the mean colour along an edge; over half the length if the whole length would
        leave the range of brightness of the neighbours."""
        near = 0.5 * (self.read(place - along / 6.0, last) + self.read(place + along / 6.0, last))
        ends = 0.5 * (self.read(place - along / 2.0, last) + self.read(place + along / 2.0, last))
        mean = 0.5 * (near + ends)
        return ti.select(mean[GREEN] < least or mean[GREEN] > most, near, mean)

    @ti.func
    def read(self, place, last):
        """Interpolates the canvas bilinearly."""
        p = ti.math.clamp(place, 0.0, ti.cast(last, ti.f32))
        low = ti.cast(p, ti.i32)
        high, t = ti.min(low + 1, last), p - low
        below = ti.math.mix(
            colour_of(self.canvas[low.x, low.y]), colour_of(self.canvas[high.x, low.y]), t.x
        )
        above = ti.math.mix(
            colour_of(self.canvas[low.x, high.y]), colour_of(self.canvas[high.x, high.y]), t.x
        )
        return ti.math.mix(below, above, t.y)
