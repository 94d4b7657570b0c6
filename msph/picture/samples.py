"""Shading as often as the picture varies: few samples where a block of pixels is even.

What a ray from the eye finds is a wall, seen through much that varies slowly over the picture:
where on the wall, how lit, how tinted, what is mirrored before it. A block of pixels is sampled at
its corners; where all four find the same, the rays between take bilinear means, and only the tiles
and the caustics are looked up for each. Elsewhere every pixel is sampled.
"""

import taichi as ti

from msph.taichi_internals import on_cpu

SPAN = 4  # pixels along each side of a block: at 8 more are uneven, and it takes as long
CORNERS = 4
# A sample is a 4 x 4 matrix, of which means can be taken. Its rows: place on the wall [m] and width
# of the pixel there [m]; share of the wall's light that arrives, RGB, and sunlight at the wall over
# SUN_LIGHT; light added on the way, linear RGB, and sky light at the wall over SKY_LIGHT; depth
# of the place under water [m], depth along the view [m], opacity of edges before it, 0.
PLACE, LEFT, ADDED, REST = range(4)
Sample = ti.types.matrix(4, 4, ti.f32)
# What a sample found is told by an i32, its kind: the axis that the wall lies across, or BARE; and
# in the bits above whatever else must not be mixed. Or VOID, plus up to 3.
BARE = 3  # no tiles: all light is added on the way
DETAIL = 1 << 20  # added to the kind where a block is uneven whatever its other corners found
VOID = DETAIL - 4  # and above, up to DETAIL: there is nothing to draw
# Most that light added may change over an even block, of a white wall's: glints and mirrored tiles.
MOST_ADDED = 0.2
# Most that the place at one corner may lie off the plane of the other three, in pixel widths. Steep
# ripples are then within 4/255 of full sampling in 99 of 100 pixels; without this limit, within 16.
MOST_BENT = 2.0
# Blocks of pixels per chunk of a CPU's thread: as many pixels as elsewhere; per block of a GPU.
CPU_BLOCKS, GPU_BLOCKS = 16, 128


@ti.func
def make_sample(place, light, left, added, under, depth, rim):
    """A sample of its parts; light: sun and sky at the place."""
    return Sample(
        [
            [place.x, place.y, place.z, place.w],
            [left.x, left.y, left.z, light.x],
            [added.x, added.y, added.z, light.y],
            [under, depth, rim, 0.0],
        ]
    )


@ti.func
def draw_blocks(source: ti.template(), note, width, height):
    """Draw width x height pixels of a source of samples, an object with four functions:

    begin(i, j, note): of the block from pixel (i, j) on, whether anything is left to be drawn,
    whether it may be even, and a note for `trace`; wanted(i, j): whether a pixel is to be drawn;
    trace(i, j, note): what the ray through a pixel finds, kind and sample; put(i, j, kind, sample):
    draws a pixel.
    """
    ti.loop_config(block_dim=CPU_BLOCKS if ti.static(on_cpu()) else GPU_BLOCKS)
    for a, b in ti.ndrange((width + SPAN - 1) // SPAN, (height + SPAN - 1) // SPAN):
        drawn, even, told = source.begin(a * SPAN, b * SPAN, note)
        if drawn:
            even = even and (a + 1) * SPAN <= width and (b + 1) * SPAN <= height
            draw_block(source, a * SPAN, b * SPAN, even, told, width, height)


@ti.func
def draw_block(source: ti.template(), i0, j0, even, note, width, height):
    """The corners, then the pixels between: in one loop, so that `trace` is compiled once."""
    first, agreed = VOID, 0
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
                even = even and slope <= MOST_ADDED and bent <= MOST_BENT * base[PLACE, 3]
            if even and first >= VOID:
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
                # Over elements in loops: written out, they would take a second to compile.
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
