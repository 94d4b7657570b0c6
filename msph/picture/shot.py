"""Parameters of a frame for the rendering kernels: the struct `Shot`, in device memory (`Lens`).

All values are in box coordinates: eye, sun and up are rotated into the box, so a tilt does not move
the mesh. A table written when the view changes replaces a struct argument, which costs 0.2 ms per
launch. Kernels read box, look and image size from the shot and need no recompilation.
"""

import numpy as np
import taichi as ti

from msph.device_table import DeviceTable
from msph.picture.optics import refracted

vec2, vec3, ivec2 = ti.math.vec2, ti.math.vec3, ti.math.ivec2

NEAR_PLANE = 0.005  # near plane [m]
DEPTH_RANGE = 1.3  # range of distinct depths, over the box's depth
WALL_SKIN = 2e-3  # distance within which a face is on a wall, over the longest edge
# Most cells of the map of water levels along the longer side of the floor, and cells of the map of
# caustics along each side.
LEVEL_CELLS, CAUSTIC_CELLS = 28, 128
MIN_DESCENT = 0.3  # smallest descent of sunbeams under water, when the box is tilted
TILE = 1 / 12  # edge of a tile, over the longest edge of the box
PARALLEL = 1e-6  # components of a direction below this count as zero
UNIT_CORNERS = np.indices((2, 2, 2)).reshape(3, 8).T  # corners of the unit box, (8, 3)

Shot = ti.types.struct(
    eye=vec3,  # camera [m]
    forward=vec3,  # unit view direction
    origin=vec3,  # ray through the centre of pixel (0, 0); its forward part is 1
    du=vec3,  # ray step to the next pixel on the right
    dv=vec3,  # ray step to the next pixel up
    to_i=vec3,  # dot with (p - eye) / depth, plus centre.x: pixel coordinate i
    to_j=vec3,  # likewise j
    centre=vec2,  # pixel coordinates of the view axis
    pixel=ti.f32,  # width of a pixel at depth 1
    columns=ti.i32,  # rays to the right and up
    rows=ti.i32,
    w_near=ti.f32,  # largest 1 / depth [1/m]
    w_span=ti.f32,  # range of 1 / depth [1/m]
    to_world=ti.math.mat3,  # box frame to world frame
    up=vec3,  # world up in the box frame
    sun=vec3,  # unit vector to the sun
    beam=vec3,  # to the sun, from under a level water surface (refracted)
    ground=ti.f32,  # height of the ground along `up`, relative to the box centre [m]
    size=vec3,  # box [m]
    immersed=ti.i32,  # 1: the eye is in the box, or above it where there is no lid
    lid=ti.i32,  # 1: a pane of glass closes the top of the box
    skin=ti.f32,  # distance within which a face is on a wall [m]
    first=ivec2,  # pixels (right, up) between which the box, water and bodies may be visible, now
    last=ivec2,  # or in the view before: first to last - 1
    tiles=vec3,  # tiles per metre along x, y, z
    eta=ti.f32,  # refractive index of air over index of water
    reflection=ti.f32,  # share of mirrored light that is shown
    contrast=ti.f32,  # share of the caustics' contrast, 0 without caustics
    absorption=vec3,  # Beer-Lambert coefficients, RGB [1/m]
    scatter=vec3,  # colour of deep water, RGB, linear
    drying=ti.i32,  # 1: walls and bodies are darker where water has been
    ripples=ti.i32,  # 1: the surface has small ripples
    plain=ti.i32,  # 1: the background is a gradient from `low_colour` to `high_colour`, linear
    low_colour=vec3,
    high_colour=vec3,
    drift=vec2,  # horizontal displacement (x, z) of sunlight under water per metre of descent
    level_cells=vec2,  # cells of the map of water levels along x and z
    map_corner=vec2,  # (x, z) of the corner of the caustic map [m]
    map_scale=vec2,  # cells of the caustic map per metre
)


def shot_numbers(camera, tilt, box, width, height, look, region=None, spacing=0.0):
    """Computes the members of a `Shot` from a camera, a tilt (3x3 or None), a box (Lx, Ly, Lz) [m],
    the number of rays, a look, the extent of the water's surface [m], by default the box, and the
    largest distance between vertices of the surface [m]."""
    box = np.asarray(box, float)
    # No cell of the water levels is without a vertex.
    levels = np.round(box[[0, 2]] * min(LEVEL_CELLS / box[[0, 2]].max(), 1 / max(spacing, 1e-9)))
    region = box if region is None else np.asarray(region, float)
    R, C = np.eye(3) if tilt is None else np.asarray(tilt, float), box / 2
    right, up, back = (R.T @ a for a in camera.axes())
    eye = C + R.T @ (camera.eye - C)
    step = 2 * np.tan(camera.fov / 2) / height
    across = camera.stretch * step
    du, dv, forward = across * right, step * up, -back
    to_i, to_j = right / across, up / step
    corners = UNIT_CORNERS * box
    depths = (UNIT_CORNERS * region - C) @ forward * DEPTH_RANGE + (C - eye) @ forward
    near = max(depths.min(), NEAR_PLANE)
    far = max(depths.max(), 2 * near)
    middle = np.array(((0.5 + camera.shift) * width - 0.5, height / 2 - 0.5))
    around = np.concatenate([corners, UNIT_CORNERS * region]) - eye
    depth, whole = around @ forward, np.array((width, height))
    first, last = np.zeros(2, int), whole
    if depth.min() > NEAR_PLANE:
        pixels = middle + around @ np.stack((to_i, to_j), 1) / depth[:, None]
        first = np.clip(np.floor(pixels.min(axis=0) - 1), 0, whole).astype(int)
        last = np.clip(np.ceil(pixels.max(axis=0) + 1) + 1, 0, whole).astype(int)
    sun = R.T @ look.sun_direction()
    beam = -refracted(-sun, R[1], 1 / look.refractive_index)
    drift = -beam[[0, 2]] / max(beam[1], MIN_DESCENT)
    colours = look.background_colours()
    shift = drift * box[1]  # displacement of light from brim to floor
    return {
        "eye": eye,
        "forward": forward,
        "origin": forward - middle[0] * du + (0.5 - height / 2) * dv,
        "du": du,
        "dv": dv,
        "to_i": to_i,
        "to_j": to_j,
        "centre": middle,
        "pixel": min(step, across),
        "columns": width,
        "rows": height,
        "w_near": 1 / near,
        "w_span": 1 / near - 1 / far,
        "to_world": R.ravel(),
        "up": R[1],
        "sun": sun,
        "beam": beam,
        "ground": ((corners - C) @ R[1]).min(),
        "size": box,
        "immersed": bool((eye > 0).all() and (eye < region).all()),
        "lid": region[1] == box[1],
        "skin": WALL_SKIN * box.max(),
        "first": first,
        "last": last,
        "tiles": np.maximum(np.round(box / (TILE * box.max())), 1) / box,
        "eta": 1 / look.refractive_index,
        "reflection": look.reflection,
        "contrast": look.caustic_contrast * look.caustics,
        "absorption": np.asarray(look.absorption) * look.tint,
        "scatter": np.asarray(look.scatter),
        "drying": look.drying > 0.0,
        "ripples": look.ripples,
        "plain": colours is not None,
        "low_colour": colours[0] if colours else np.zeros(3),
        "high_colour": colours[1] if colours else np.zeros(3),
        "drift": drift,
        "level_cells": np.maximum(levels, 2),
        "map_corner": np.minimum(shift, 0),
        "map_scale": CAUSTIC_CELLS / (box[[0, 2]] + np.abs(shift)),
    }


@ti.func
def ray(i, j, shot: ti.template()):
    """Returns the ray through pixel (i, j), with the forward part 1."""
    return shot.origin + shot.du * i + shot.dv * j


@ti.func
def slabs(p, d, lo, hi):
    """Returns the distances, in units of d and by axis, at which the ray d from p enters and leaves
    the slabs between lo and hi [m]; finite where d is parallel to a slab."""
    per = 1.0 / (d + ti.select(abs(d) < PARALLEL, PARALLEL, 0.0))
    a, b = (lo - p) * per, (hi - p) * per
    return ti.min(a, b), ti.max(a, b)


class Lens:
    """Holds the shot of the present frame: `shot[None]` in kernels, `numbers` on the host."""

    def __init__(self):
        self.table = DeviceTable((), **Shot.members)
        self.shot = self.table.struct
        self.numbers = {}
        # Pixels (first, last) of the last view, by its number of rays.
        self.filled: dict[tuple[int, int], tuple] = {}

    def set(self, numbers, whole=False):
        """Writes the result of `shot_numbers` to the device. whole: items may be anywhere in the
        image, not only in the box."""
        size = numbers["columns"], numbers["rows"]
        now = ((0, 0), size) if whole else (numbers["first"], numbers["last"])
        # Another size of images uses other pixels, which may hold items of any view.
        before = self.filled.get(size, ((0, 0), size))
        self.filled = {size: now}
        first, last = np.minimum(now[0], before[0]), np.maximum(now[1], before[1])
        self.numbers = {**numbers, "first": first, "last": last}
        self.table.fill(**self.numbers)
