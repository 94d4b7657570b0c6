"""Drawing of whitewater as small soft discs over the image of the water."""

import taichi as ti

from msph.launches import data_oriented, kernel
from msph.picture.rasteriser import NO_ITEM
from msph.surface.whitewater import MOST, Whitewater
from msph.taichi_internals import on_cpu

vec3 = ti.math.vec3

# Radius of a disc, over the longest edge of the box, and its least radius [pixels].
RADIUS, LEAST_RADIUS = 2.6e-3, 0.7
# Opacity of a disc in its centre, and the remaining life (-) in which it fades.
OPACITY, FADES = 0.55, 0.5
# Display-referred colour.
FOAM = (0.92, 0.96, 0.98)
# Depth under the surface [box edges] at which bubbles show half their opacity, and depth within
# which foam lies on the surface.
HIDING_DEPTH, ON_SURFACE = 0.06, 0.01


@data_oriented
class WhitewaterView:
    """Draws whitewater into the 3-vec field `image` that a WaterShader has drawn."""

    def __init__(self, whitewater: Whitewater, shader, image):
        self.whitewater, self.shader, self.image = whitewater, shader, image
        self.lens, self.raster, self.backdrop = shader.lens, shader.raster, shader.backdrop
        # In parallel, discs that overlap would be blended in any order.
        self.serial = on_cpu()

    @kernel
    def draw(self):
        ti.loop_config(serialize=self.serial)
        for k in range(MOST):
            life = self.whitewater.table.life[k]
            if life > 0.0:
                self.draw_disc(self.whitewater.table.x[k], life)

    @ti.func
    def draw_disc(self, x, life):
        """Draws a particle at x [m]; life: its remaining life (-)."""
        shot = self.lens.shot[None]
        c = x - shot.eye
        place = self.raster.project(c, shot)
        m, z = place.xy, place.z
        if z > 1.0 / shot.w_near:
            at = ti.cast(ti.round(m), ti.i32)
            radius = ti.max(RADIUS * shot.size.max() / (shot.pixel * z), LEAST_RADIUS)
            if at.min() >= 0 and at.x < shot.columns and at.y < shot.rows:
                shown = OPACITY * ti.min(1.0, life / FADES)
                shown *= self.visible(c, at, z, shot)
                box = self.raster.bounds(m - radius, m + radius, shot)
                for i in range(box[0], box[2] + 1):
                    for j in range(box[1], box[3] + 1):
                        q2 = (ti.Vector([i, j]) - m).norm_sqr() / (radius * radius)
                        opacity = shown * ti.max(1.0 - q2, 0.0)
                        self.image[i, j] = ti.math.mix(self.image[i, j], vec3(FOAM), opacity)

    @ti.func
    def visible(self, c, at, z, shot: ti.template()):
        """Returns the share (-) of a particle at c [m] from the eye, at the depth z [m], that is
        visible at a pixel: 0 behind bodies and tiles, decreasing with depth under the surface."""
        share = 1.0
        if self.backdrop.covers(at.x, at.y, z) or self.shader.pool.hides(c, shot):
            share = 0.0
        elif self.raster.key[at.x, at.y] != NO_ITEM:
            d = shot.origin + shot.du * at.x + shot.dv * at.y
            depth = self.shader.hit_surface(at.x, at.y, d, shot)[0]
            size = shot.size.max()
            under = ti.max(z - depth - ON_SURFACE * size, 0.0) / (HIDING_DEPTH * size)
            share = 0.5**under
        return share
