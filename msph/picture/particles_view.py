"""Rendering of particles as shaded spheres, coloured by an attribute with a perceptual colour
map."""

import numpy as np
import taichi as ti

from msph.launches import data_oriented, kernel
from msph.picture.pixels import word
from msph.picture.pool import RIM
from msph.picture.rasteriser import BLOCK, NO_ITEM, sphere_inverse_depth
from msph.picture.shot import ray
from msph.picture.tone import curve

vec3 = ti.math.vec3

COLOURS = 256
# Stops of the map in CIE Lab, dark blue over teal and green to pale yellow: lightness rises
# evenly, so that equal steps of the value look equal.
LAB_STOPS = np.array(
    [
        (24.0, 20.0, -52.0),
        (38.0, 10.0, -50.0),
        (53.0, -14.0, -28.0),
        (67.0, -40.0, 4.0),
        (80.0, -32.0, 46.0),
        (94.0, -8.0, 60.0),
    ]
)
D65 = np.array((0.9505, 1.0, 1.089))
XYZ_TO_RGB = np.array(
    [(3.2406, -1.5372, -0.4986), (-0.9689, 1.8758, 0.0415), (0.0557, -0.2040, 1.0570)]
)
AMBIENT, DIFFUSE, SHINE = 0.46, 0.62, 0.35
MIN_RANGE = 1e-30  # smallest range of values, against division by zero
SHEEN_POWER = 5  # highlight: cosine^(2^5)


def colour_map():
    """Returns linear RGB (COLOURS, 3) of even steps through `LAB_STOPS`."""
    x = np.linspace(0, len(LAB_STOPS) - 1, COLOURS)
    lab = np.stack([np.interp(x, np.arange(len(LAB_STOPS)), c) for c in LAB_STOPS.T], 1)
    f = (lab[:, :1] + 16) / 116 + lab[:, 1:2] * (1 / 500, 0, 0) - lab[:, 2:] * (0, 0, 1 / 200)
    xyz = D65 * np.where(f > 6 / 29, f**3, (f - 4 / 29) * 3 * (6 / 29) ** 2)
    return np.clip(xyz @ XYZ_TO_RGB.T, 0, 1)


def shown_colour(value):
    """Returns the display-referred RGB (..., 3) of lit particles with a value (...) in 0..1."""
    return curve(colour_map()[np.int32(np.clip(value, 0, 1) * (COLOURS - 1) + 0.5)])


@data_oriented
class ParticlesView:
    """Draws spheres over a backdrop into the field `image` of words."""

    def __init__(self, lens, rasteriser, tone, image):
        self.lens, self.raster, self.tone, self.image = lens, rasteriser, tone, image
        self.map = ti.Vector.field(3, ti.f32, COLOURS)
        self.map.from_numpy(colour_map().astype(np.float32))

    @kernel
    def draw(
        self,
        x: ti.template(),
        radius: ti.template(),
        value: ti.template(),
        lo: ti.f32,
        hi: ti.f32,
        n: ti.i32,
        backdrop: ti.template(),
    ):
        """Draws the first n spheres; see Picture.draw_particles."""
        self.raster.clear(n)
        self.raster.draw_spheres(n, x, radius)
        scale = 1.0 / ti.max(hi - lo, MIN_RANGE)
        ti.loop_config(block_dim=BLOCK)
        for i, j in ti.ndrange(self.lens.shot[None].columns, self.lens.shot[None].rows):
            key = self.raster.key[i, j]
            self.image[i, j] = backdrop.colour[i, j]
            if key != NO_ITEM:
                shot = self.lens.shot[None]
                p = self.raster.item(i, j)
                d = ray(i, j, shot)
                v = ti.math.clamp((value[p] - lo) * scale, 0.0, 1.0)
                base = self.map[ti.cast(v * (COLOURS - 1) + 0.5, ti.i32)]
                w = sphere_inverse_depth(x[p] - shot.eye, radius[p], d)
                if not backdrop.covers(i, j, 1.0 / ti.max(w, 1e-9)):
                    c = self.lit(base, x[p] - shot.eye, radius[p], d, shot)
                    line = backdrop.lines[i, j]
                    self.image[i, j] = word(ti.math.mix(self.tone.display(c), RIM, line))

    @ti.func
    def lit(self, base, c, r, d, shot: ti.template()):
        """Returns the colour where the ray d meets a sphere of radius r at c (from the eye)."""
        n = (d / ti.max(sphere_inverse_depth(c, r, d), 1e-9) - c) / r
        sky = 0.5 + 0.5 * n.dot(shot.up)
        sun = ti.max(n.dot(shot.sun), 0.0)
        half = ti.max(n.dot((shot.sun - d.normalized()).normalized()), 0.0)
        for _ in ti.static(range(SHEEN_POWER)):
            half *= half
        return base * (AMBIENT * (0.4 + 0.6 * sky) + DIFFUSE * sun) + SHINE * half * vec3(1.0)
