"""Drawing of spilt water as drops that fall outside the box, over the image of the water."""

import taichi as ti

from msph.fluid.boundary.rim import MOST_DROPS, Rim
from msph.launches import data_oriented, kernel
from msph.picture.optics import bend, cosine_beyond, reflectance
from msph.picture.rasteriser import NO_ITEM
from msph.taichi_internals import on_cpu

vec2, vec3 = ti.math.vec2, ti.math.vec3

# Smallest cosine of incidence and smallest radius [pixels].
MIN_INCIDENCE, LEAST_RADIUS = 0.05, 0.7
# Share of light that passes a drop, and its opacity in the centre and at the edge. The pool
# behind a drop is not traced, and shows through.
CLEAR, CENTRE, EDGE = 0.92, 0.2, 0.7


@data_oriented
class DropsView:
    """Draws the drops of a Rim into the 3-vec field `image` that a WaterShader has drawn."""

    def __init__(self, rim: Rim, shader, image):
        self.rim, self.shader, self.image = rim, shader, image
        self.lens, self.raster, self.pool = shader.lens, shader.raster, shader.pool
        self.backdrop, self.tone = shader.backdrop, shader.tone
        # In parallel, drops that overlap would be blended in any order.
        self.serial = on_cpu()

    @kernel
    def draw(self):
        ti.loop_config(serialize=self.serial)
        for k in range(MOST_DROPS):
            if self.rim.drops.life[k] > 0.0:
                self.draw_drop(self.rim.drops.x[k], self.rim.drops.radius[k])

    @ti.func
    def draw_drop(self, x, radius):
        """Draws a ball of water at x [m] with a radius [m]."""
        shot = self.lens.shot[None]
        c = x - shot.eye
        place = self.raster.project(c, shot)
        m, z = place.xy, place.z
        if z > 1.0 / shot.w_near:
            r = ti.max(radius / (shot.pixel * z), LEAST_RADIUS)
            at = ti.cast(ti.round(m), ti.i32)
            inside = at.min() >= 0 and at.x < shot.columns and at.y < shot.rows
            if inside and self.is_visible(c, at, z, shot):
                box = self.raster.bounds(m - r - 0.5, m + r + 0.5, shot)
                for i in range(box[0], box[2] + 1):
                    for j in range(box[1], box[3] + 1):
                        q = (vec2(i, j) - m) / r
                        cover = ti.math.clamp((1.0 - q.norm()) * r + 0.5, 0.0, 1.0)
                        if cover > 0.0:
                            colour = self.tone.display(self.radiance(c.normalized(), q, shot))
                            cover *= ti.math.mix(CENTRE, EDGE, ti.min(q.norm_sqr(), 1.0))
                            self.image[i, j] = ti.math.mix(self.image[i, j], colour, cover)

    @ti.func
    def radiance(self, d, q, shot: ti.template()):
        """Returns the radiance of a drop along d (unit) at q, the offset from its centre in radii:
        sky or ground, mirrored at the front and refracted twice."""
        depth = ti.sqrt(ti.max(1.0 - q.norm_sqr(), 0.0))
        n = q.x * shot.du.normalized() + q.y * shot.dv.normalized() - depth * shot.forward
        c = ti.max(-d.dot(n), MIN_INCIDENCE)
        ct = cosine_beyond(c, shot.eta)
        # Both refractions turn the ray by the same angle, towards the axis.
        once = bend(d, n, c, ct, shot.eta)
        through = 2.0 * once.dot(d) * once - d
        share = reflectance(c, ct, shot.eta)
        mirrored = self.pool.far_radiance(d + 2.0 * c * n, shot)
        behind = CLEAR * self.pool.background(through.normalized(), shot)
        return ti.math.mix(behind, mirrored, share)

    @ti.func
    def is_visible(self, c, at, z, shot: ti.template()):
        """Returns False for a drop behind tiles, water or a body; c [m] from the eye, z: depth
        [m]."""
        hidden = self.pool.hides(c, shot)
        if self.raster.key[at.x, at.y] != NO_ITEM:
            ray = shot.origin + shot.du * at.x + shot.dv * at.y
            hidden = hidden or self.shader.hit_surface(at.x, at.y, ray, shot)[0] < z
        return not (hidden or self.backdrop.covers(at.x, at.y, z))
