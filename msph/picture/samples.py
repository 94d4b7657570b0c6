"""Adaptive sampling: shading at the corners of even blocks of pixels, and at every pixel elsewhere.

A sample describes the wall at the end of a ray and what lies in front: place, light, tint,
reflections, all of which vary slowly over the image. If the four corners of a block find the same
surfaces, the pixels between interpolate their samples bilinearly, and only tiles and caustics are
evaluated per pixel. Adjacent blocks share corners: one ray per block.
"""

import taichi as ti

from msph.launches import data_oriented, heavy_kernel, kernel
from msph.taichi_internals import on_cpu

SPAN = 4  # pixels along each side of a block; 8 is no faster, since more blocks are uneven
# Rows of a 4 x 4 sample: place on the wall [m] and pixel width there [m]; share of the wall's light
# that reaches the eye, RGB, and sunlight at the wall over SUN_LIGHT; light added on the way, linear
# RGB, and sky light at the wall over SKY_LIGHT; depth of the place under water (in a backdrop: of
# the entry into a container along the view) [m], depth along the view [m], opacity of edge lines in
# front, 0.
PLACE, LEFT, ADDED, REST = range(4)
Sample = ti.types.matrix(4, 4, ti.f32)
# Kind (i32) of a sample: samples of different kinds are not interpolated. Its lowest digit is the
# axis of the wall, or UNTILED.
UNTILED = 3  # no tiles: all light is added on the way
DETAIL = 1 << 20  # added to the kind to make a block uneven
EMPTY = DETAIL - 4  # kinds EMPTY to DETAIL - 1: nothing to draw
MAX_ADDED_CHANGE = 0.2  # largest change of added light in an even block, over a white wall's
# Largest distance of a corner's place from the plane of the other three, in pixel widths: 99 % of
# the pixels at steep ripples are then within 4/255 of full sampling (16/255 without the limit).
MAX_OFF_PLANE = 1.0
# Pixels of a column per loop iteration on a CPU, which divides to find the place of an iteration,
# and vectorises inner loops.
STRIP = 256
CPU_BLOCKS, GPU_BLOCKS = 16, 128  # blocks of pixels that a CPU thread takes in turn, per GPU block
# States of a block: SKIPPED, or its note times STATES plus EVEN or UNEVEN.
SKIPPED, EVEN, UNEVEN, STATES = range(4)
# What `trace` computes: samples at the corners of blocks, or the pixels of uneven blocks.
AT_CORNERS, AT_PIXELS = range(2)


@ti.func
def make_sample(place, light, left, added, rest):
    """Builds a sample from its parts; light: sun and sky at the place."""
    return Sample(
        [
            [place.x, place.y, place.z, place.w],
            [left.x, left.y, left.z, light.x],
            [added.x, added.y, added.z, light.y],
            [rest.x, rest.y, rest.z, rest.w],
        ]
    )


class SampleFields:
    """For each corner (a, b) of blocks, at pixel (SPAN a, SPAN b): kind and sample of its ray, and
    the state of the block above and to the right of it."""

    def __init__(self, width: int, height: int):
        size = width // SPAN + 2, height // SPAN + 2
        self.kind, self.state = (ti.field(ti.i32, size) for _ in range(2))
        self.sample = ti.Matrix.field(4, 4, ti.f32, size)


@data_oriented
class BlockSampler:
    """Draws a source, an object with four functions:

    begin(i, j, given) returns, for the block from pixel (i, j) on: whether there is anything to
    draw, whether the block may be even, and a note (from 0 on) for `trace`; wanted(i, j): whether
    to draw a pixel; trace(i, j, note): kind and sample of a pixel's ray, where a corner has the
    largest note of its blocks; put(i, j, kind, sample): draws a pixel.
    """

    def __init__(self, source, fields: SampleFields):
        self.source = source
        self.kind, self.state, self.sample = fields.kind, fields.state, fields.sample
        self.chunk = CPU_BLOCKS if on_cpu() else GPU_BLOCKS

    def draw(self, columns, rows, given=0):
        """Draws columns x rows pixels; given (i32): for `begin`."""
        self.begin(columns, rows, given)
        self.trace(columns, rows, AT_CORNERS)
        self.interpolate(columns, rows)
        self.trace(columns, rows, AT_PIXELS)

    @kernel
    def begin(self, columns: ti.i32, rows: ti.i32, given: ti.i32):
        """Sets the states of blocks. Blocks at the right and upper edge of the image are uneven."""
        ti.loop_config(block_dim=self.chunk)
        for a, b in ti.ndrange(blocks(columns) + 1, blocks(rows) + 1):
            i, j, state = a * SPAN, b * SPAN, SKIPPED
            if i < columns and j < rows:
                drawn, even, note = self.source.begin(i, j, given)
                if drawn:
                    even = even and i + SPAN < columns and j + SPAN < rows
                    state = note * STATES + ti.select(even, EVEN, UNEVEN)
            self.state[a, b] = state

    @heavy_kernel
    def trace(self, columns: ti.i32, rows: ti.i32, stage: ti.i32):
        """Computes samples at the corners of even blocks, or draws all pixels of uneven blocks: one
        kernel, so that the source's `trace` is compiled once."""
        ti.loop_config(block_dim=self.chunk)
        for a, b in ti.ndrange(blocks(columns) + 1, blocks(rows) + 1):
            number, note = 0, self.state[a, b] // STATES
            if stage == AT_CORNERS:
                note = self.corner_note(a, b)
                number = ti.cast(note >= 0, ti.i32)
            elif self.state[a, b] % STATES == UNEVEN:
                number = SPAN * SPAN
            for k in range(number):
                i, j = a * SPAN + k // SPAN, b * SPAN + k % SPAN
                if stage == AT_CORNERS or (i < columns and j < rows and self.source.wanted(i, j)):
                    kind, sample = self.source.trace(i, j, note)
                    if stage == AT_CORNERS:
                        self.kind[a, b], self.sample[a, b] = kind, sample
                    else:
                        self.source.put(i, j, kind, sample)

    @ti.func
    def corner_note(self, a, b):
        """Returns the largest note of the even blocks at a corner, -1 without any."""
        note = -1
        for k in range(4):
            c, d = a - k // 2, b - k % 2
            if c >= 0 and d >= 0 and self.state[c, d] % STATES == EVEN:
                note = ti.max(note, self.state[c, d] // STATES)
        return note

    @kernel
    def interpolate(self, columns: ti.i32, rows: ti.i32):
        """Draws even blocks whose corners agree; the others become uneven."""
        ti.loop_config(block_dim=self.chunk)
        for a, b in ti.ndrange(blocks(columns), blocks(rows)):
            if self.state[a, b] % STATES == EVEN:
                first, base, along_i, along_j, twist = self.corners(a, b)
                slope = abs(along_i[ADDED, :]) + abs(along_j[ADDED, :]) + abs(twist[ADDED, :])
                bend, most = abs(twist[PLACE, :]).xyz.max(), MAX_OFF_PLANE * base[PLACE, 3]
                even = first >= 0 and first < DETAIL and bend <= most
                if not (even and slope.xyz.max() <= MAX_ADDED_CHANGE):
                    self.state[a, b] += UNEVEN - EVEN
                elif first < EMPTY:
                    for m in range(SPAN):
                        left, along = base + m / SPAN * along_i, along_j + m / SPAN * twist
                        for n in range(SPAN):
                            sample = left + n / SPAN * along
                            self.source.put(a * SPAN + m, b * SPAN + n, first, sample)

    @ti.func
    def corners(self, a, b):
        """Returns the kind of a block's corners, -1 if they differ, and their bilinear form: sample
        of the first, changes along both axes, twist."""
        kind = self.kind[a, b]
        base, right = self.sample[a, b], self.sample[a + 1, b]
        above, far = self.sample[a, b + 1], self.sample[a + 1, b + 1]
        for k in range(1, 4):
            if self.kind[a + k // 2, b + k % 2] != kind:
                kind = -1
        return kind, base, right - base, above - base, far - right - above + base


@ti.func
def blocks(pixels):
    """Returns the number of blocks along an axis."""
    return (pixels + SPAN - 1) // SPAN


def strip_length() -> int:
    """Returns the number of pixels of a column per loop iteration."""
    return STRIP if on_cpu() else 1


@ti.func
def strips(rows, length):
    """Returns the number of strips of a column."""
    return (rows + length - 1) // length
