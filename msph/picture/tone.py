"""Tone mapping: linear radiance to display values by a soft shoulder and the sRGB curve,
tabulated."""

import numpy as np
import taichi as ti

from msph.launches import data_oriented

CELLS = 4096
WHITE = 1.6  # radiance shown as white
KNEE = 0.65  # radiance up to which the curve is the identity
CLAY = (0.60, 0.26, 0.15)  # albedo, linear RGB, of bodies without a colour


def curve(x):
    """Returns the display-referred value of the linear radiance x, both about 0..1 (NumPy)."""
    room = 1 - KNEE
    y = np.where(x < KNEE, x, KNEE + room * (1 - np.exp(-np.maximum(x - KNEE, 0) / room)))
    y = np.minimum(y / (KNEE + room * (1 - np.exp(-(WHITE - KNEE) / room))), 1)
    return np.where(y <= 0.0031308, 12.92 * y, 1.055 * np.maximum(y, 1e-9) ** (1 / 2.4) - 0.055)


def linear(display):
    """Returns the linear radiance of a display-referred value, 0..1 (NumPy): inverse of `curve`."""
    x = np.linspace(0, WHITE, CELLS)
    return np.interp(display, curve(x), x)


def albedo(colour):
    """Returns the albedo, linear RGB (3,), of a colour (3,) in sRGB (NumPy; IEC 61966-2-1)."""
    c = np.asarray(colour)
    return np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)


@data_oriented
class Tone:
    def __init__(self):
        self.table = ti.field(ti.f32, CELLS)
        x = np.linspace(0, WHITE, CELLS)
        self.table.from_numpy(curve(x).astype(np.float32))

    @ti.func
    def display(self, c):
        """Returns the display-referred colour of the linear colour c."""
        k = ti.cast(ti.math.clamp(c * ((CELLS - 1) / WHITE), 0.0, CELLS - 1.0) + 0.5, ti.i32)
        k = ti.min(k, CELLS - 1)
        return ti.math.vec3(self.table[k.x], self.table[k.y], self.table[k.z])
