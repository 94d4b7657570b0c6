"""The shading of water: what a ray sees that meets the surface.

Fresnel's share of the light is reflected (tiled wall, sky, sun glint); the rest is bent (Snell),
goes on to the pool's floor or wall, whose colour is dimmed along the way under water (Beer-Lambert)
and mixed with light scattered by the water itself.
"""

import taichi as ti

from msph.picture.optics import WATER_INDEX, bend, cosine_beyond, reflectance, transmittance
from msph.picture.pool import FLATTEST, RIM, along
from msph.picture.rasteriser import BLOCK, NOTHING
from msph.picture.sky import SUN
from msph.taichi_internals import data_oriented

vec3 = ti.math.vec3

GLINT, SHEEN = 40.0, 2.5  # brightness of the sun's mirror image, and of the ripples' round it
SHEEN_GLOSS, GLINT_GLOSS = 6, 5  # widths: cosine^(2^6) and that^(2^5)
FLAT = 0.98  # least cosine between a cut face's normal and the wall's
GRAZING = 0.03  # least cosine of incidence counted with
DOWNWELLING = 0.5  # share of absorption on the light's own way down


@data_oriented
class Water:
    def __init__(self, mesh, lens, rasteriser, pool, light, backdrop, tone):
        self.lens = lens
        self.mesh, self.raster, self.pool, self.light = mesh, rasteriser, pool, light
        self.backdrop, self.tone = backdrop, tone

    @ti.func
    def shade(self, skin, image: ti.template()):
        """The picture from the visibility buffer: water where it is seen, else the backdrop."""
        ti.loop_config(block_dim=BLOCK)
        for i, j in ti.ndrange(self.raster.width, self.raster.height):
            key = self.raster.key[i, j]
            behind = self.backdrop.colour[i, j]
            if key == NOTHING:
                image[i, j] = behind.xyz
            else:
                shot = self.lens.shot[None]
                back = ti.bit_cast(self.raster.back[i, j], ti.f32)
                d = shot.origin + shot.du * i + shot.dv * j
                t = key & self.raster.item_mask
                depth, flat, n = self.strike(t, d, shot)
                image[i, j] = behind.xyz
                if not self.backdrop.covers(i, j, depth):
                    c = self.colour(depth, flat, n, d, back, skin, shot)
                    image[i, j] = ti.math.mix(self.tone.show(c), RIM, behind.w)

    @ti.func
    def strike(self, t, d, shot: ti.template()):
        """Depth at which the ray d meets the plane of triangle t, its normal, the smooth normal."""
        k = self.mesh.triangles[t]
        a = self.mesh.vertices[k[0]] - shot.eye
        b = self.mesh.vertices[k[1]] - shot.eye
        c = self.mesh.vertices[k[2]] - shot.eye
        flat = (b - a).cross(c - a)
        u, v, w = d.dot(b.cross(c)), d.dot(c.cross(a)), d.dot(a.cross(b))
        n = u * self.mesh.normals[k[0]] + v * self.mesh.normals[k[1]] + w * self.mesh.normals[k[2]]
        # Front faces have negative weights: the sum points inwards.
        return a.dot(flat) / d.dot(flat), flat.normalized(), -n.normalized()

    @ti.func
    def colour(self, depth, flat, n, d, back, skin, shot: ti.template()):
        """Linear colour of the water along the ray d, whose strike gave depth and normals; back:
        depth of its far side."""
        stretch = d.norm()
        p = shot.eye + d * depth
        d /= stretch
        room = ti.min(p, shot.size - p)
        cut = ti.min(room.x, room.z) < skin and ti.max(abs(flat.x), abs(flat.z)) > FLAT
        if cut:
            n = ti.round(flat)
        p = ti.math.clamp(p, 0.0, shot.size)
        c = ti.max(-d.dot(n), GRAZING)
        ct = cosine_beyond(c, 1.0 / WATER_INDEX)
        r = bend(d, n, c, ct, 1.0 / WATER_INDEX)
        reach = depth * stretch
        inner = self.inner(p, r, cut, (back - depth) * stretch, reach, shot)
        mirrored, outer = d + 2.0 * c * n, vec3(0.0)
        if cut:
            outer = self.pool.around(mirrored, shot)
        else:
            outer = self.outer(p, mirrored, reach, shot)
        return ti.math.mix(inner, outer, reflectance(c, ct, 1.0 / WATER_INDEX))

    @ti.func
    def inner(self, p, r, cut, thickness, reach, shot: ti.template()):
        """Light that comes along the bent ray r from p: the pool through water.

        cut: whether p is on a wall; thickness: way through the water [m]; reach: from the eye [m].
        """
        s, axis, low = self.pool.leave(p, r, shot.size)
        t, body, _ = self.pool.meet(p, r, s)
        s = ti.min(s, t)
        q = p + r * s
        path, depth = s, p.y - q.y
        if cut or thickness < s:
            depth = self.light.height(q, shot) - q.y
            if cut and r.y > 0.0 and depth < 0.0 and p.y < self.light.height(p, shot):
                # Up to the surface from below: total reflection folds the ray down again.
                q.y = ti.math.clamp(q.y + 2.0 * depth, 0.0, shot.size.y)
                depth = -depth
            else:
                # Once through a crest or a drop, it may enter the water below it again.
                again = ti.max(depth, 0.0) / ti.max(abs(r.y), FLATTEST)
                path = ti.min(s, thickness + again)
        depth = ti.max(depth, 0.0)
        footprint = shot.pixel * (reach + s) / ti.max(abs(along(r, axis)), FLATTEST)
        focus = self.light.concentration(q, depth, shot) * self.pool.sunlit(q, r, shot.beam)
        colour = vec3(0.0)
        if body < 0:
            colour = self.pool.albedo(q, axis, footprint, shot)
            colour *= self.pool.light(q, axis, low, shot.beam, focus, shot)
        elif ti.static(self.pool.occupied):
            colour = self.pool.bodies.shade(body, q, shot.beam, focus, shot)
        left = transmittance(shot.absorption, path + DOWNWELLING * depth)
        return colour * left + shot.scatter * (1.0 - left)

    @ti.func
    def outer(self, p, r, reach, shot: ti.template()):
        """Light that comes along the mirrored ray r: tiled wall, or sky with the sun."""
        rise = r.dot(shot.up)
        if rise < 0.0:  # other waves would be met: take the sky that they mirror
            r -= 2.0 * rise * shot.up
        s, axis, low = self.pool.leave(p, r, shot.size)
        t, body, _ = self.pool.meet(p, r, s)
        colour = vec3(0.0)
        if body >= 0:
            if ti.static(self.pool.occupied):
                colour = self.pool.bodies.shade(body, p + r * t, shot.sun, 1.0, shot)
        elif self.pool.is_tiled(axis, low, shot):
            footprint = shot.pixel * (reach + s) / ti.max(abs(along(r, axis)), FLATTEST)
            colour = self.pool.dry(p + r * s, axis, low, 1.0, footprint, shot)
        else:
            sheen = ti.max(r.dot(shot.sun), 0.0)
            for _ in ti.static(range(SHEEN_GLOSS)):
                sheen *= sheen
            glint = sheen
            for _ in ti.static(range(GLINT_GLOSS)):
                glint *= glint
            colour = self.pool.around(r, shot) + SUN * (GLINT * glint + SHEEN * sheen)
        return colour
