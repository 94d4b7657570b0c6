"""The shading of water: what a ray sees that meets the surface.

Fresnel's share of the light is reflected (tiled wall, sky, sun glint); the rest is bent (Snell),
goes on to the pool's floor or wall, whose colour is dimmed along the way under water (Beer-Lambert)
and mixed with light scattered by the water itself.
"""

import taichi as ti

from msph.picture.light_sources import SKY_LIGHT, SUN_LIGHT
from msph.picture.optics import bend, cosine_beyond, reflectance, transmittance
from msph.picture.pool import FLATTEST, RIM, along
from msph.picture.rasteriser import KEY_BITS, NOTHING
from msph.picture.samples import (
    BARE,
    CORNERS,
    DETAIL,
    PLACE,
    REST,
    SPAN,
    draw_blocks,
    make_sample,
)
from msph.picture.sky import SUN
from msph.taichi_internals import data_oriented, kernel

vec2, vec3, vec4 = ti.math.vec2, ti.math.vec3, ti.math.vec4

GLINT, SHEEN = 40.0, 2.5  # brightness of the sun's mirror image, and of the ripples' round it
SHEEN_GLOSS, GLINT_GLOSS = 6, 5  # widths: cosine^(2^6) and that^(2^5)
FLAT = 0.98  # least cosine between a cut face's normal and the wall's
GRAZING = 0.03  # least cosine of incidence counted with
DOWNWELLING = 0.5  # share of absorption on the light's own way down
# Change of depth that is a step from crest to trough, in keys: a thousandth of all.
STEP = int(1e-3 * 2**KEY_BITS)
NEAR_GLINT = 0.5  # sheen from which on the sun's mirror image may lie between two samples
# Places in a kind: the low wall of two; seen through a side of the water; folded by total
# reflection; out of the water again; the body.
LOW, CUT, FOLDED, LEFT_AGAIN, BODY = 4, 8, 16, 32, 64


@data_oriented
class Water:
    def __init__(self, mesh, lens, rasteriser, light, backdrop, image):
        """image: the 3-vec field that is drawn, display-referred."""
        self.mesh, self.lens, self.raster, self.light = mesh, lens, rasteriser, light
        self.backdrop, self.pool, self.tone = backdrop, backdrop.pool, backdrop.tone
        self.image = image

    @kernel
    def shade(self):
        """The picture from the visibility buffer: water where it is seen, else the backdrop."""
        draw_blocks(self, 0, self.lens.shot[None].columns, self.lens.shot[None].rows)

    @ti.func
    def begin(self, i0, j0, note):
        """Of a block: whether water is seen, and whether in every pixel and without a step in
        depth. Without water it shows the backdrop. The note is not used."""
        columns, rows = self.lens.shot[None].columns, self.lens.shot[None].rows
        nearest, farthest = NOTHING, 0
        # One loop of constant length, which repeats pixels at the picture's edge: nested loops with
        # variable bounds take LLVM five times as long to compile.
        for k in range(SPAN * SPAN):
            i, j = ti.min(i0 + k // SPAN, columns - 1), ti.min(j0 + k % SPAN, rows - 1)
            key = self.raster.key[i, j]
            nearest, farthest = ti.min(nearest, key), ti.max(farthest, key)
        even = farthest != NOTHING
        if nearest == NOTHING:
            for k in range(SPAN * SPAN):
                i, j = ti.min(i0 + k // SPAN, columns - 1), ti.min(j0 + k % SPAN, rows - 1)
                self.image[i, j] = self.backdrop.colour[i, j].xyz
        elif even:
            # On a plane the corners are the nearest and the farthest.
            near, far = NOTHING, 0
            for k in range(CORNERS):
                i, j = i0 + (SPAN - 1) * (k // 2), j0 + (SPAN - 1) * (k % 2)
                near, far = ti.min(near, self.raster.key[i, j]), ti.max(far, self.raster.key[i, j])
            slack = STEP + (far - near) // 2
            even = near - nearest < slack and farthest - far < slack
        return nearest != NOTHING, even, note

    @ti.func
    def wanted(self, i, j):
        """Of a block with water, pixels without it show the backdrop."""
        wet = self.raster.key[i, j] != NOTHING
        if not wet:
            self.image[i, j] = self.backdrop.colour[i, j].xyz
        return wet

    @ti.func
    def put(self, i, j, kind, sample):
        """Water, or a body before it."""
        shot = self.lens.shot[None]
        behind = self.backdrop.colour[i, j]
        shown = behind.xyz
        if not self.backdrop.covers(i, j, sample[REST, 1]):
            q = vec3(sample[PLACE, 0], sample[PLACE, 1], sample[PLACE, 2])
            focus = self.light.concentration(q, sample[REST, 0], shot)
            c = self.pool.finish(kind, sample, focus, shot)
            shown = ti.math.mix(self.tone.show(c), RIM, behind.w)
        self.image[i, j] = shown

    @ti.func
    def trace(self, i, j, note):
        """What is seen through the water that a pixel shows."""
        shot = self.lens.shot[None]
        d = shot.origin + shot.du * i + shot.dv * j
        back = ti.bit_cast(self.raster.back[i, j], ti.f32)
        depth, flat, n = self.strike(self.raster.item(i, j), d, shot)
        stretch = d.norm()
        p = shot.eye + d * depth
        d /= stretch
        room = ti.min(p, shot.size - p)
        cut = ti.min(room.x, room.z) < shot.skin and ti.max(abs(flat.x), abs(flat.z)) > FLAT
        if cut:
            n = ti.round(flat)
        p = ti.math.clamp(p, 0.0, shot.size)
        c = ti.max(-d.dot(n), GRAZING)
        ct = cosine_beyond(c, shot.eta)
        bent, mirrored = bend(d, n, c, ct, shot.eta), d + 2.0 * c * n
        rise = mirrored.dot(shot.up)
        if rise < 0.0 and not cut:  # other waves would be met: take the sky that they mirror
            mirrored -= 2.0 * rise * shot.up
        reach, thickness = depth * stretch, (back - depth) * stretch
        kind, under, sky, detail = 0, 0.0, vec3(0.0), False
        place, light, left, added = vec4(0.0), vec2(0.0), vec3(0.0), vec3(0.0)
        # First the bent ray, then the mirrored one: in a loop, so that the code by which rays meet
        # walls and bodies is compiled once.
        for way in range(2):
            inwards = way == 0
            r = ti.select(inwards, bent, mirrored)
            to_sun = ti.select(inwards, shot.beam, shot.sun)
            s, axis, low = self.pool.leave(p, r, shot.size)
            t, body, _, close = self.pool.meet(p, r, s, reach, shot)
            s = ti.min(s, t)
            q, through, deep, lit = p + r * s, vec3(0.0), 0.0, 1.0
            footprint = shot.pixel * (reach + s) / ti.max(abs(along(r, axis)), FLATTEST)
            if inwards:
                q, deep, path, bits = self.submerged(p, q, r, s, cut, thickness, shot)
                through = transmittance(shot.absorption, path + DOWNWELLING * deep)
                lit = self.pool.sunlit(q, r, to_sun)
                kind = axis + LOW * low + CUT * cut + bits + DETAIL * close
            lighting = self.pool.lighting(q, axis, low, to_sun, shot)
            seen = vec3(0.0)
            if ti.static(self.pool.occupied):
                if body >= 0:
                    focus = 1.0
                    if inwards:
                        kind += BARE - axis - LOW * low + BODY * (1 + body)
                        focus = lit * self.light.concentration(q, deep, shot)
                    seen = self.pool.bodies.shade(body, q, to_sun, focus, shot)
            if inwards:
                place, under, left = vec4(q, footprint), deep, through
                light = lighting * vec2(lit, 1.0)
                added = shot.scatter * (1.0 - through) + through * seen
            else:
                sky, detail = self.mirror(q, r, axis, low, cut, lighting, footprint, shot)
                if body >= 0:
                    sky = seen
                detail = detail or close
        share = shot.reflection * reflectance(c, ct, shot.eta)
        left, added = left * (1.0 - share), ti.math.mix(added, sky, share)
        sample = make_sample(place, light, left, added, under, depth, 0.0)
        return kind + DETAIL * detail, sample

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
    def submerged(self, p, q, r, s, cut, thickness, shot: ti.template()):
        """Of the bent ray r from p, through water, s [m] long: where it ends [m], how deep under
        water [m], its way through water [m], and bits of the kind.

        cut: whether p is on a wall; thickness: way through the water [m]."""
        path, deep, bits = s, p.y - q.y, 0
        if cut or thickness < s:
            deep = self.light.height(q, shot) - q.y
            if cut and r.y > 0.0 and deep < 0.0 and p.y < self.light.height(p, shot):
                # Up to the surface from below: total reflection folds the ray down again.
                q.y = ti.math.clamp(q.y + 2.0 * deep, 0.0, shot.size.y)
                deep = -deep
                bits = FOLDED
            else:
                # Once through a crest or a drop, it may enter the water below it again.
                again = ti.max(deep, 0.0) / ti.max(abs(r.y), FLATTEST)
                path = ti.min(s, thickness + again)
                bits = LEFT_AGAIN
        return q, ti.max(deep, 0.0), path, bits

    @ti.func
    def mirror(self, q, r, axis, low, cut, light, footprint, shot: ti.template()):
        """Light that comes along the mirrored ray r: the tiled wall at q [m], lit so (sun, sky), or
        sky with the sun; and whether the sun's image is near. cut: whether the ray begins on a
        wall, out of the box."""
        colour, detail = vec3(0.0), False
        if not cut and self.pool.is_tiled(axis, low, shot):
            colour = self.pool.albedo(q, axis, footprint, shot)
            colour *= SUN_LIGHT * light.x + SKY_LIGHT * light.y
        else:
            sheen = ti.max(r.dot(shot.sun), 0.0)
            for _ in ti.static(range(SHEEN_GLOSS)):
                sheen *= sheen
            glint = sheen
            for _ in ti.static(range(GLINT_GLOSS)):
                glint *= glint
            sunny = ti.select(cut, 0.0, GLINT * glint + SHEEN * sheen)
            detail = not cut and sheen > NEAR_GLINT
            colour = self.pool.around(r, shot) + SUN * sunny
        return colour, detail
