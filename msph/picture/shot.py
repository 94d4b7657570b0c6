"""All that a drawing kernel needs to know of one frame: the `Shot`, held on the device by a `Lens`.

Everything is in box coordinates: eye, sun and up are turned into the box instead of the mesh into
the world, so a tilt costs nothing. A struct argument of this size costs 0.2 ms a launch; a table
that is written only when the camera moves costs nothing. Kernels read the box, the look and the
image size from the shot, so none of them is compiled again when these change.
"""

import numpy as np
import taichi as ti

from msph.device_table import DeviceTable
from msph.picture.optics import refracted

vec2, vec3 = ti.math.vec2, ti.math.vec3

NEAREST = 0.02  # near plane [m]
REACH = 1.3  # how far beyond the box things are still given distinct depths
SKIN = 2e-3  # how near to a wall a face counts as lying on it, as a share of the longest edge
# Cells of the map of water levels along the longer side of the floor (coarser than the mesh), and
# of the map of caustics along each side.
LEVEL_CELLS, CAUSTIC_CELLS = 28, 128
STEEPEST = 0.3  # least descent of a sunbeam under water counted with, when the box is tilted
TILE = 1 / 12  # edge of a tile, as a share of the longest edge of the box
UNIT_CORNERS = np.indices((2, 2, 2)).reshape(3, 8).T  # of a box of edge 1, (8, 3)

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
    columns=ti.i32,  # pixels that are drawn, to the right and up
    rows=ti.i32,
    w_near=ti.f32,  # 1 / depth of the nearest thing drawn [1/m]
    w_span=ti.f32,  # w_near less the same of the farthest [1/m]
    right_world=vec3,  # box frame to world frame: rows of R
    up=vec3,  # second row: world up in the box frame
    back_world=vec3,
    sun=vec3,  # unit vector to the sun
    sun_inverse=vec3,  # 1 / sun by component
    beam=vec3,  # to the sun, from under a level water surface (refracted)
    ground=ti.f32,  # height of the ground along `up`, measured from the box centre [m]
    size=vec3,  # box [m]
    skin=ti.f32,  # how near to a wall a face counts as lying on it [m]
    lo=vec2,  # pixels between which the box lies
    hi=vec2,
    tiles=vec3,  # tiles per metre along x, y, z
    eta=ti.f32,  # refractive index of air over the water's
    reflection=ti.f32,  # share of mirrored light that is shown
    contrast=ti.f32,  # share of the caustics' contrast, 0 without caustics
    absorption=vec3,  # Beer-Lambert coefficients, RGB [1/m]
    scatter=vec3,  # colour of deep water, RGB, linear
    drift=vec2,  # (x, z) that sunlight under water travels per metre of descent
    level_cells=vec2,  # cells of the map of water levels along x and z
    map_corner=vec2,  # (x, z) of the corner of the caustic map [m]
    map_scale=vec2,  # cells of the caustic map per metre
)


def shoot(camera, tilt, box, width, height, look):
    """The numbers of a `Shot`, by name: of a camera, a tilt (3x3 or None), a box (Lx, Ly, Lz)."""
    box = np.asarray(box, float)
    R, C = np.eye(3) if tilt is None else np.asarray(tilt, float), box / 2
    right, up, back = (R.T @ a for a in camera.axes())
    eye = C + R.T @ (camera.eye - C)
    step = 2 * np.tan(camera.fov / 2) / height
    across = camera.stretch * step
    du, dv, forward = across * right, step * up, -back
    to_i, to_j = right / across, up / step
    corners = UNIT_CORNERS * box
    depths = (corners - C) @ forward * REACH + (C - eye) @ forward
    near = max(depths.min(), NEAREST)
    far = max(depths.max(), 2 * near)
    middle = np.array(((0.5 + camera.shift) * width - 0.5, height / 2 - 0.5))
    z = (corners - eye) @ forward
    lo, hi = np.zeros(2), np.array((width, height))
    if z.min() > NEAREST:
        pixels = middle + (corners - eye) @ np.stack((to_i, to_j), 1) / z[:, None]
        lo, hi = pixels.min(0) - 1, pixels.max(0) + 1
    sun = R.T @ look.sun_direction()
    beam = -refracted(-sun, R[1], 1 / look.refractive_index)
    drift = -beam[[0, 2]] / max(beam[1], STEEPEST)
    shift = drift * box[1]  # how far light drifts from brim to floor
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
        "right_world": R[0],
        "up": R[1],
        "back_world": R[2],
        "sun": sun,
        "sun_inverse": 1 / np.where(np.abs(sun) < 1e-6, 1e-6, sun),
        "beam": beam,
        "ground": ((corners - C) @ R[1]).min(),
        "size": box,
        "skin": SKIN * box.max(),
        "lo": lo,
        "hi": hi,
        "tiles": np.maximum(np.round(box / (TILE * box.max())), 1) / box,
        "eta": 1 / look.refractive_index,
        "reflection": look.reflection,
        "contrast": look.caustic_contrast * look.caustics,
        "absorption": np.asarray(look.absorption) * look.tint,
        "scatter": np.asarray(look.scatter),
        "drift": drift,
        "level_cells": np.maximum(np.round(box[[0, 2]] * LEVEL_CELLS / box[[0, 2]].max()), 2),
        "map_corner": np.minimum(shift, 0),
        "map_scale": CAUSTIC_CELLS / (box[[0, 2]] + np.abs(shift)),
    }


class Lens:
    """Holds the shot of the present frame: `shot[None]` in a kernel, `numbers` outside."""

    def __init__(self):
        self.table = DeviceTable((), **Shot.members)
        self.shot = self.table.struct
        self.numbers = {}

    def set(self, numbers):
        """numbers: as `shoot` gives them."""
        self.numbers = numbers
        self.table.fill(**numbers)
