"""Adaptive sampling: shading at the corners of even blocks of pixels, and at every pixel elsewhere.

A sample describes the wall at the end of a ray and what lies in front: place, light, tint,
reflections, all of which vary slowly over the image. If the four corners of a block find the same
surfaces, the pixels between interpolate their samples bilinearly, and only tiles and caustics are
evaluated per pixel.
"""

import taichi as ti

from msph.taichi_internals import on_cpu

SPAN = 4  # pixels along each side of a block; 8 is no faster, since more blocks are uneven
CORNERS = 4
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
MAX_OFF_PLANE = 2.0
CPU_BLOCKS, GPU_BLOCKS = 16, 128  # blocks of pixels per chunk of a CPU thread, per GPU block


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


@ti.func
def draw_blocks(source: ti.template(), note, width, height):
    """Draws width x height pixels of a source, an object with four functions:

    begin(i, j, note) returns, for the block from pixel (i, j) on: whether there is anything to
    draw, whether the block may be even, and a note for `trace`; wanted(i, j): whether to draw a
    pixel; trace(i, j, note): kind and sample of a pixel's ray; put(i, j, kind, sample): draws a
    pixel.
    """
    ti.loop_config(block_dim=CPU_BLOCKS if ti.static(on_cpu()) else GPU_BLOCKS)
    for a, b in ti.ndrange((width + SPAN - 1) // SPAN, (height + SPAN - 1) // SPAN):
        drawn, even, block_note = source.begin(a * SPAN, b * SPAN, note)
        if drawn:
            even = even and (a + 1) * SPAN <= width and (b + 1) * SPAN <= height
            draw_block(source, a * SPAN, b * SPAN, even, block_note, width, height)


@ti.func
def draw_block(source: ti.template(), i0, j0, even, note, width, height):
    """Draws the corners, then the other pixels, in one loop, so that `trace` is compiled once."""
    first, agreed = EMPTY, 0
    base, along_i, along_j, twist = Sample(0.0), Sample(0.0), Sample(0.0), Sample(0.0)
    for k in range(CORNERS + SPAN * SPAN):
        is_corner = k < CORNERS
        a, b = (k - CORNERS) // SPAN, (k - CORNERS) % SPAN
        if is_corner:
            a, b = (SPAN - 1) * (k // 2), (SPAN - 1) * (k % 2)
        if k == CORNERS:
            even = even and agreed == CORNERS and first < DETAIL
            for n in range(3):
                slope = abs(along_i[ADDED, n]) + abs(along_j[ADDED, n]) + abs(twist[ADDED, n])
                bent = abs(twist[PLACE, n])
                even = even and slope <= MAX_ADDED_CHANGE and bent <= MAX_OFF_PLANE * base[PLACE, 3]
            if even and first >= EMPTY:
                break
        again = not is_corner and a % (SPAN - 1) == 0 and b % (SPAN - 1) == 0
        i, j = i0 + a, j0 + b
        if not again and i < width and j < height and source.wanted(i, j):
            u, v = a / (SPAN - 1), b / (SPAN - 1)
            kind, sample = first, Sample(0.0)
            if is_corner or not even:
                kind, sample = source.trace(i, j, note)
            if is_corner:
                if k == 0:
                    first = kind
                agreed += kind == first
                # Runtime loops over elements: unrolled, they would take a second to compile.
                for m, n in ti.ndrange(4, 4):
                    part = sample[m, n]
                    base[m, n] += (1.0 - u) * (1.0 - v) * part
                    along_i[m, n] += (2.0 * u - 1.0) * (1.0 - v) * part
                    along_j[m, n] += (1.0 - u) * (2.0 * v - 1.0) * part
                    twist[m, n] += (2.0 * u - 1.0) * (2.0 * v - 1.0) * part
            elif even:
                for m, n in ti.ndrange(4, 4):
                    slope = along_j[m, n] + u * twist[m, n]
                    sample[m, n] = base[m, n] + u * along_i[m, n] + v * slope
            source.put(i, j, kind, sample)
