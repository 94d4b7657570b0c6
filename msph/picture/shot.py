"""All that a drawing kernel needs to know of one frame: the `Shot`, held on the device by a `Lens`.

Everything is in box coordinates: eye, sun and up are turned into the box instead of the mesh into
the world, so a tilt costs nothing. A struct argument of this size costs .2 ms a launch; a small
field that is written only when the camera moves costs nothing.
"""

import numpy as np
import taichi as ti

from msph.picture.optics import refracted
from msph.taichi_internals import data_oriented, kernel

vec2, vec3 = ti.math.vec2, ti.math.vec3

NEAREST = 0.02  # near plane [m]
REACH = 1.3  # how far beyond the box things are still given distinct depths
STEEPEST = 0.3  # least descent of a sunbeam under water counted with, when the box is tilted
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
    lo=vec2,  # pixels between which the box lies
    hi=vec2,
    tiles=vec3,  # tiles per metre along x, y, z
    eta=ti.f32,  # refractive index of air over the water's
    reflection=ti.f32,  # share of mirrored light that is shown
    contrast=ti.f32,  # share of the caustics' contrast
    absorption=vec3,  # Beer-Lambert coefficients, RGB [1/m]
    scatter=vec3,  # colour of deep water, RGB, linear
    drift=vec2,  # (x, z) that sunlight under water travels per metre of descent
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
        "lo": lo,
        "hi": hi,
        "tiles": np.maximum(np.round(box / (look.tile * box.max())), 1) / box,
        "eta": 1 / look.refractive_index,
        "reflection": look.reflection,
        "contrast": look.caustic_contrast,
        "absorption": np.asarray(look.absorption) * look.tint,
        "scatter": np.asarray(look.scatter),
        "drift": drift,
        "map_corner": np.minimum(shift, 0),
        "map_scale": look.caustic_cells / (box[[0, 2]] + np.abs(shift)),
    }


@data_oriented
class Lens:
    """Holds the shot of the present frame: `shot[None]` in a kernel, `numbers` outside."""

    def __init__(self):
        self.shot = Shot.field(shape=())
        self.numbers = {}
        parts = [self.shot.get_member_field(name) for name in Shot.members]
        self.slots = [
            [p.get_scalar_field(k) for k in range(p.n)] if hasattr(p, "n") else [p] for p in parts
        ]

    def set(self, numbers):
        """numbers: as `shoot` gives them."""
        self.numbers = numbers
        flat = [np.ravel(numbers[name]) for name in Shot.members]
        self.store(np.concatenate(flat).astype(np.float32))

    @kernel
    def store(self, numbers: ti.types.ndarray(dtype=ti.f32, ndim=1)):
        k = 0
        for slots in ti.static(self.slots):
            for slot in ti.static(slots):
                slot[None] = numbers[k]
                k += 1
