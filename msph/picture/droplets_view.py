"""Drawing of spray, spilt water and whitewater over the image of the water, in screen space.

Every droplet adds to sums over the pixels that it covers, so that their order does not matter. In
the time of an exposure a droplet draws a streak: a weight w = (1 - q^2)^2 at q radii from a line,
times the area of a disc over the area of the streak. Droplets that are large in the image merge
into water where the sum of their weights exceeds FILM: with the height h = sum(w r)/sum(w)
sqrt(sum(w) - FILM) towards the eye, the water has normals, refracts the image behind, mirrors sky
and sun, and is whitish. Small droplets and whitewater are mist of the opacity 1 - exp(-sum). A
whitewater particle that lies on the surface is a patch of foam, level in the world, that grows and
opens to a ring while it dissolves: many of them are a field of patches and lace that moves with the
water.
"""

import math

import taichi as ti

from msph.fluid.boundary.rim import MOST_DROPS, Rim
from msph.fluid.particles.layers import SPHERE_RADIUS
from msph.launches import data_oriented, kernel
from msph.picture.optics import cosine_beyond, reflectance
from msph.picture.pixels import colour_of, word
from msph.picture.pool import GOLDEN
from msph.picture.rasteriser import BLOCK, NO_ITEM
from msph.picture.samples import strips
from msph.picture.shot import ray
from msph.picture.sky import SUN
from msph.surface.spray import DROPLETS, WIDE, Spray
from msph.surface.whitewater import MOST, Whitewater

vec2, vec3 = ti.math.vec2, ti.math.vec3

# Time of an exposure [s]: the shutter is open for a quarter of a frame of 30 per second.
EXPOSURE = 1.0 / 120.0
# Integer value of a weight of 1: integers add up to the same sum in any order.
UNIT = 1024.0
# Least radius of a droplet [pixels]; a smaller one has less weight.
LEAST_RADIUS = 0.8
# Radius of a droplet in images over its radius (-): spray looks finer than 48 droplets can be that
# hold the volume of a particle.
FINER = 0.7
# Radii [pixels] between which droplets turn from mist to water.
MIST, WATER = 0.8, 4.0
# Sum of weights (-) at the edge of water, and where the water is opaque in a pixel.
FILM, INSIDE = 0.12, 0.3
# Opacity of the mist of a droplet, and of whitewater, in its centre.
MISTY, WHITE = 0.7, 0.6
# Whitish share of a droplet, and more where sunlight that it focuses leaves it.
WHITISH, FOCUS = 0.15, 0.5
# Shift of the refracted image, over the height of the water.
BENDING = 0.9
# Power of the cosine in the sun's reflection, and its brightness.
GLOSS, GLINT = 150.0, 1.6
# Mean radius of whitewater, over the longest edge of the box, and the remaining life (-) in which
# it fades.
RADIUS, FADES = 2.0e-3, 0.5
# Radius of a patch of foam when it forms and when it has dissolved, over the longest edge of the
# box, and its opacity at first (-).
PATCH, DISSOLVED, FROTH = 0.012, 0.026, 0.4
# Least sine of the angle between the ray and the horizontal by which a patch is flattened.
GRAZING = 0.25
# Display-referred colour of scattered sunlight.
SCATTERED = (0.92, 0.96, 0.98)
# Depth under the surface [box edges] at which droplets and bubbles show half their opacity, and
# depth within which they lie on the surface.
HIDING_DEPTH, ON_SURFACE = 0.06, 0.01
# Squared length [pixels^2] below which a streak has no direction.
LEAST = 1e-6


@ti.dataclass
class Droplet:
    """Droplet at x [m] with a velocity v [m/s] and a radius [m]; opacity of its mist (-); white: 1
    if it is always mist; foam (-): 1 for a patch on the surface; life (-): of the patch."""

    x: vec3
    v: vec3
    radius: ti.f32
    opacity: ti.f32
    white: ti.i32
    foam: ti.f32
    life: ti.f32


@data_oriented
class DropletsView:
    """Draws droplets into the image that a WaterShader has drawn. sums: see DropletSums."""

    def __init__(self, spray: Spray, rim: Rim, whitewater: Whitewater, shader, sums, image):
        self.spray, self.rim, self.whitewater = spray, rim, whitewater
        self.shader, self.image, self.sums = shader, image, sums
        self.lens, self.raster, self.pool = shader.lens, shader.raster, shader.pool
        self.backdrop, self.tone = shader.backdrop, shader.tone
        self.needed = False  # until there are droplets

    def show(self, white: bool, spilt: bool, sprayed: bool) -> None:
        """Draws whitewater, spilt water, spray, each if asked for and there."""
        white = white and self.whitewater.started
        self.needed = self.needed or white or spilt or (sprayed and self.spray.count[None] > 0)
        if self.needed:
            self.draw(int(white), int(spilt), int(sprayed))

    @kernel
    def draw(self, white: ti.i32, spilt: ti.i32, sprayed: ti.i32):
        """white, spilt, sprayed: 1 to draw whitewater, spilt water, spray."""
        self.sums.lo[None], self.sums.hi[None] = NO_ITEM, -1
        first = white * MOST
        after = first + spilt * MOST_DROPS * DROPLETS
        ti.loop_config(block_dim=BLOCK)
        for q in range(after + sprayed * self.spray.count[None] * DROPLETS):
            drop, m = Droplet(radius=0.0), (q - first) % DROPLETS
            if q < first:
                if self.whitewater.table.life[q] > 0.0:
                    drop = self.white_one(q)
            elif q < after:
                k = (q - first) // DROPLETS
                if self.rim.drops.life[k] > 0.0:
                    drop = self.spilt_one(k, m)
            else:
                x, radius, v = self.spray.droplet(self.spray.loose[(q - after) // DROPLETS], m)
                drop = Droplet(
                    x=x, v=v, radius=FINER * radius, opacity=MISTY, white=0, foam=0.0, life=1.0
                )
            if drop.radius > 0.0:
                self.add(drop, self.lens.shot[None])
        # Only within the bounds of the droplets, which are empty if lo = hi + 1.
        ti.loop_config(serialize=True)
        for _ in range(1):
            self.sums.lo[None] = ti.min(self.sums.lo[None], self.sums.hi[None] + 1)
        strip = self.raster.strip
        ti.loop_config(block_dim=self.raster.block)
        for i, s in ti.ndrange((self.sums.lo[None][0], self.sums.hi[None][0] + 1), self.strips()):
            for j in range(self.sums.lo[None][1] + s * strip, self.end(s, strip)):
                if self.sums.weight[i, j] + self.sums.mist[i, j] > 0:
                    self.sums.shown[i, j] = word(self.colour(i, j, self.lens.shot[None]))
        ti.loop_config(block_dim=self.raster.block)
        for i, s in ti.ndrange((self.sums.lo[None][0], self.sums.hi[None][0] + 1), self.strips()):
            for j in range(self.sums.lo[None][1] + s * strip, self.end(s, strip)):
                if self.sums.weight[i, j] + self.sums.mist[i, j] > 0:
                    self.image[i, j] = self.sums.shown[i, j]
                    self.sums.weight[i, j] = self.sums.height[i, j] = self.sums.mist[i, j] = 0

    @ti.func
    def strips(self):
        """Returns the number of strips of a column within the bounds."""
        return strips(self.sums.hi[None][1] + 1 - self.sums.lo[None][1], self.raster.strip)

    @ti.func
    def end(self, s, strip):
        """Returns the row after strip s."""
        return ti.min(self.sums.lo[None][1] + (s + 1) * strip, self.sums.hi[None][1] + 1)

    @ti.func
    def white_one(self, k):
        """Returns the k-th whitewater particle."""
        table, longest = self.whitewater.table, self.lens.shot[None].size.max()
        life, foam = table.life[k], table.foam[k]
        fading = ti.min(1.0, life / FADES)
        patch = ti.math.mix(DISSOLVED, PATCH, life)
        return Droplet(
            x=table.x[k],
            v=(1.0 - foam) * table.v[k],
            radius=ti.math.mix(RADIUS * (0.5 + ti.math.fract(GOLDEN * k)), patch, foam) * longest,
            opacity=ti.math.mix(WHITE, FROTH * life, foam) * fading,
            white=ti.cast(foam > 0.0, ti.i32),
            foam=foam,
            life=life,
        )

    @ti.func
    def spilt_one(self, k, m):
        """Returns the m-th droplet of the k-th drop outside the box."""
        v, size = self.rim.drops.v[k], self.rim.drops.radius[k]
        q, radius = self.spray.cluster(k, m, v, WIDE * size / SPHERE_RADIUS, size)
        x = self.rim.drops.x[k] + q
        return Droplet(x=x, v=v, radius=radius, opacity=MISTY, white=0, foam=0.0, life=1.0)

    @ti.func
    def add(self, drop, shot: ti.template()):
        """Adds a droplet to the sums."""
        c = drop.x - shot.eye
        place = self.raster.project(c, shot)
        start = self.raster.project(c - EXPOSURE * drop.v, shot)
        m, z = place.xy, place.z
        at = ti.cast(ti.round(m), ti.i32)
        inside = ti.min(z, start.z) > 1.0 / shot.w_near and at.min() >= 0
        if inside and at.x < shot.columns and at.y < shot.rows:
            true_radius = drop.radius / (shot.pixel * z)
            r = ti.max(true_radius, LEAST_RADIUS)
            way = start.xy - m
            area = ti.select(drop.white == 1, 1.0, (true_radius / r) ** 2)
            shown = area / (1.0 + 2.0 / math.pi * way.norm() / r)
            shown *= self.visible(c, at, z, shot)
            water = ti.math.smoothstep(MIST, WATER, true_radius) * (1 - drop.white)
            level = ti.max(abs(c.normalized().dot(shot.up)), GRAZING)
            flat = vec2(r, ti.max(r * ti.math.mix(1.0, level, drop.foam), LEAST_RADIUS))
            hole = drop.foam * (1.0 - drop.life)
            lo, hi = ti.min(m, start.xy) - flat, ti.max(m, start.xy) + flat
            box = self.raster.bounds(lo, hi, shot)
            if shown > 0.0 and box[0] <= box[2] and box[1] <= box[3]:
                ti.atomic_min(self.sums.lo[None], ti.Vector([box[0], box[1]]))
                ti.atomic_max(self.sums.hi[None], ti.Vector([box[2], box[3]]))
                for i in range(box[0], box[2] + 1):
                    for j in range(box[1], box[3] + 1):
                        p = vec2(i, j) - m
                        t = ti.math.clamp(p.dot(way) / ti.max(way.norm_sqr(), LEAST), 0.0, 1.0)
                        near = ti.max(1.0 - ((p - t * way) / flat).norm_sqr(), 0.0)
                        ring = 4.0 * near * (1.0 - near)
                        w = UNIT * shown * ti.math.mix(near, ring * ring, hole) * near
                        # A branch costs less than adding 0.
                        if water > 0.0 and w >= 1.0:
                            self.sums.weight[i, j] += ti.cast(water * w, ti.i32)
                            self.sums.height[i, j] += ti.cast(water * w * r, ti.i32)
                        mist = (1.0 - water) * drop.opacity * w
                        if mist >= 1.0:
                            self.sums.mist[i, j] += ti.cast(mist, ti.i32)

    @ti.func
    def height(self, i, j, shot: ti.template()):
        """Returns the height of the water towards the eye [pixels]."""
        a, b = ti.math.clamp(i, 0, shot.columns - 1), ti.math.clamp(j, 0, shot.rows - 1)
        w = self.sums.weight[a, b] / UNIT
        mean = self.sums.height[a, b] / (UNIT * ti.max(w, 1.0 / UNIT))
        return mean * ti.sqrt(ti.max(w - FILM, 0.0))

    @ti.func
    def colour(self, i, j, shot: ti.template()):
        """Returns the display-referred colour of a pixel with the droplets in front."""
        w, shown = self.sums.weight[i, j] / UNIT, colour_of(self.image[i, j])
        cover = ti.math.smoothstep(FILM, INSIDE, w)
        if cover > 0.0:
            h = self.height(i, j, shot)
            slope = 0.5 * vec2(
                self.height(i + 1, j, shot) - self.height(i - 1, j, shot),
                self.height(i, j + 1, shot) - self.height(i, j - 1, shot),
            )
            n = vec3(-slope.x, -slope.y, 1.0).normalized()
            to = vec2(i, j) - BENDING * h * n.xy
            a = ti.math.clamp(ti.cast(ti.round(to.x), ti.i32), 0, shot.columns - 1)
            b = ti.math.clamp(ti.cast(ti.round(to.y), ti.i32), 0, shot.rows - 1)
            behind = colour_of(self.image[a, b])
            d = ray(i, j, shot).normalized()
            normal = n.x * shot.du.normalized() + n.y * shot.dv.normalized() - n.z * shot.forward
            c = ti.max(-d.dot(normal), 0.05)
            mirrored = d + 2.0 * c * normal
            share = reflectance(c, cosine_beyond(c, shot.eta), shot.eta)
            glint = ti.max(mirrored.dot(shot.sun), 0.0) ** GLOSS
            # A ray that grazes a droplet goes on to what is behind.
            sky = self.tone.display(self.pool.far_radiance(mirrored, shot))
            sky = ti.math.mix(sky, behind, ti.math.smoothstep(-0.5, 0.8, mirrored.dot(d)))
            # Sunlight leaves a droplet on the side away from the sun.
            focus = ti.max(-normal.dot(shot.sun), 0.0)
            water = ti.math.mix(behind, vec3(SCATTERED), WHITISH + FOCUS * focus * focus)
            water = ti.math.mix(water, sky, share)
            water = ti.min(water + GLINT * glint * SUN, 1.0)
            shown = ti.math.mix(shown, water, cover)
        if self.sums.mist[i, j] > 0:
            mist = 1.0 - ti.exp(-self.sums.mist[i, j] / UNIT)
            shown = ti.math.mix(shown, vec3(SCATTERED), mist)
        return shown

    @ti.func
    def visible(self, c, at, z, shot: ti.template()):
        """Returns the share (-) of a droplet at c [m] from the eye, at the depth z [m], that is
        visible at a pixel: 0 behind bodies and tiles, decreasing with depth under the surface."""
        share, key = 1.0, self.raster.key[at.x, at.y]
        inside = ((c + shot.eye) > 0.0).all() and ((c + shot.eye) < shot.size).all()
        if self.backdrop.covers(at.x, at.y, z) or (not inside and self.pool.hides(c, shot)):
            share = 0.0
        elif key != NO_ITEM:
            depth = 1.0 / self.raster.inverse_depth(key, self.raster.item_bits[None], shot)
            size = shot.size.max()
            under = ti.max(z - depth - ON_SURFACE * size, 0.0) / (HIDING_DEPTH * size)
            share = 0.5**under
        return share


class DropletSums:
    """Sums over the droplets of a pixel, in units of 1/UNIT: weights, weights times radii [pixels],
    opacities of mist; 0 between frames. shown: words of their colours with the image behind; lo,
    hi: pixels that bound the droplets."""

    def __init__(self, room):
        size = room.width, room.height
        self.weight, self.height, self.mist = (ti.field(ti.i32, size) for _ in range(3))
        self.shown = ti.field(ti.i32, size)
        self.lo, self.hi = (ti.Vector.field(2, ti.i32, ()) for _ in range(2))
