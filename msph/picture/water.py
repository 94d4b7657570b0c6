"""Shading of the water surface.

The Fresnel share of the light is reflected (tiles, sky, sun glint); the rest is refracted (Snell)
to the floor or a wall, whose colour is attenuated along the path through water (Beer-Lambert) and
mixed with light scattered by the water. From under water the surface mirrors the pool, by total
reflection outside Snell's window.
"""

import taichi as ti

from msph.launches import data_oriented
from msph.picture.backdrop import KEY_SLACK
from msph.picture.body_shading import MISSED
from msph.picture.optics import bend, cosine_beyond, reflectance, transmittance
from msph.picture.pixels import bilinear, word
from msph.picture.pool import MIN_COSINE, RIM, component
from msph.picture.rasteriser import FAR, NO_ITEM, smooth, walls_of
from msph.picture.room import COARSE
from msph.picture.samples import (
    DETAIL,
    PLACE,
    REST,
    SPAN,
    UNTILED,
    BlockSampler,
    make_sample,
)
from msph.picture.shot import ray
from msph.picture.sky import SKY_LIGHT, SUN, SUN_LIGHT

vec2, vec3, vec4 = ti.math.vec2, ti.math.vec3, ti.math.vec4

GLINT, SHEEN = 40.0, 2.5  # brightness of the sun's reflection, and of ripples around it
SHEEN_GLOSS, GLINT_GLOSS = 6, 5  # widths: cosine^(2^6), and its power 2^5
WALL_COSINE = 0.98  # smallest cosine between a cut face's normal and the wall's
MIN_INCIDENCE = 0.03  # smallest cosine of incidence
PLATE = 0.1  # largest thickness of water on glass that refracts as a plate, over the longest edge
LUMP = 0.1  # thickness of water in the air from which it refracts in full, over the longest edge
# Water in the air: thickness from which it has no relief, and thickness in which bubbles and
# reflections fade in, both over the longest edge; heights of the relief (-) between which bubbles
# fade in; largest share of light that bubbles scatter.
SMOOTH, FILM, FOAMY, MILK = 0.3, 0.012, (0.2, 1.6), 0.4
# Light that bubbles scatter from sky and sun, for normals across both.
MILK_SKY, MILK_SUN = vec3(0.24, 0.33, 0.4), vec3(0.18, 0.21, 0.2)
DOWNWELLING = 0.5  # share of absorption on the light's way down
# Places along a ray under water where light is scattered, and share of sunlight (-).
SHAFT_STEPS, SHAFTS = 16, 0.8
# Largest distance from a ray at which the outline of a body may cross an adjacent block, over the
# block's edge (-): half the diagonal, and a fifth more, since a ray's steps may skip the nearest
# point of the body.
OUTLINE_REACH = 0.85
NEAR_GLINT = 0.5  # sheen above which the sun's reflection may lie between two samples
# Bits of a kind: low wall; seen through a side of the water; folded by total reflection; out of the
# water again; number of the body (bits below SUNK); eye under water; whole ray under water.
LOW, CUT, FOLDED, LEFT_AGAIN, BODY, SUNK, STRAIGHT = 4, 8, 16, 32, 64, 1 << 14, 1 << 15


@data_oriented
class WaterShader:
    """Shades water over a backdrop into the field `image` of words."""

    def __init__(self, mesh, lens, rasteriser, sunlight, ripples, backdrop, image, samples):
        self.mesh, self.lens, self.raster, self.sunlight = mesh, lens, rasteriser, sunlight
        self.ripples, self.rippled = ripples, ripples is not None
        self.backdrop, self.pool, self.tone = backdrop, backdrop.pool, backdrop.tone
        self.image = image
        self.sampler = BlockSampler(self, samples)

    def shade(self):
        """Draws the image from the visibility buffer: water, or the backdrop."""
        self.sampler.draw(self.lens.numbers["columns"], self.lens.numbers["rows"])

    @ti.func
    def begin(self, i0, j0, given):
        """Sets up a block for BlockSampler: an even block if all its pixels and the corners of the
        next blocks show water without a step in depth, behind no body. Draws the image without
        water. given and the note are not used."""
        shot, nearest, even = self.lens.shot[None], NO_ITEM, False
        corner = ti.Vector([i0, j0])
        for k in range(SPAN * SPAN):
            at = ti.min(
                corner + ti.Vector([k // SPAN, k % SPAN]), [shot.columns - 1, shot.rows - 1]
            )
            self.image[at] = self.backdrop.colour[at]
        if (corner + SPAN > shot.first).all() and (corner < shot.last).all():
            nearest, even = smooth(self.raster.key, i0, j0, shot.columns, shot.rows, 0)
        drawn = nearest != NO_ITEM
        if ti.static(self.traits.bodies):
            drawn = False
            for k in range(ti.select(nearest != NO_ITEM, SPAN * SPAN, 0)):
                at = ti.min(corner + ti.Vector([k // SPAN, k % SPAN]), shot.last - 1)
                drawn = drawn or self.backdrop.water_at(at.x, at.y, -KEY_SLACK, shot)
                even = even and self.backdrop.water_at(at.x, at.y, KEY_SLACK, shot)
        return drawn, even, 0

    @ti.func
    def wanted(self, i, j):
        """Returns True for a pixel with water."""
        return self.backdrop.water_at(i, j, -KEY_SLACK, self.lens.shot[None])

    @ti.func
    def put(self, i, j, kind, sample):
        """Draws water, unless a body is in front of it."""
        shot = self.lens.shot[None]
        if not self.backdrop.covers(i, j, sample[REST, 1]):
            q = vec3(sample[PLACE, 0], sample[PLACE, 1], sample[PLACE, 2])
            focus = self.sunlight.concentration(q, sample[REST, 0], shot)
            c = self.pool.colour_of(kind, sample, focus, shot)
            line = self.backdrop.lines[i, j]
            self.image[i, j] = word(ti.math.mix(self.tone.display(c), RIM, line))

    @ti.func
    def trace(self, i, j, note):
        """Returns kind and sample of the water at a pixel."""
        shot = self.lens.shot[None]
        d = ray(i, j, shot)
        back = self.back(i, j, shot)
        depth, flat, n = self.hit_surface(i, j, d, shot)
        sunk = d.dot(flat) > 0.0
        # The ray meets only water before a wall or a body.
        straight = sunk and (depth == 0.0 or self.backdrop.covers(i, j, depth))
        if straight:
            depth = 0.0
        stretch = d.norm()
        p = shot.eye + d * depth
        d /= stretch
        room = ti.min(p, shot.size - p)
        cut = ti.min(room.x, room.z) < shot.skin and ti.max(abs(flat.x), abs(flat.z)) > WALL_COSINE
        cut = cut and not sunk
        if cut:
            n = ti.round(flat)
        # The ray enters through the near side of a container.
        cut = cut or (not sunk and self.raster.item(i, j) == self.raster.wet[None])
        p = ti.math.clamp(p, 0.0, walls_of(shot))
        reach, thickness = depth * stretch, ti.max(back - depth, 0.0) * stretch
        # Share (-) of the relief and the bubbles of water in the air.
        airy, bubbles, size = 0.0, 0.0, shot.size.max()
        if not (cut or sunk) and thickness < SMOOTH * size:
            if not self.backdrop.covers(i, j, back):
                airy = 1.0 - ti.math.smoothstep(LUMP, SMOOTH, thickness / size)
        if ti.static(self.rippled):
            if not cut and not straight:
                n = self.ripples.bend(p, n, shot)
            if airy > 0.0 and shot.ripples == 1:
                n, bubbles = self.roughen(p, n, d, airy)
        eta = ti.select(sunk, 1.0 / shot.eta, shot.eta)
        c = ti.max(-d.dot(n), MIN_INCIDENCE)
        ct = cosine_beyond(c, eta)
        bent, mirrored = bend(d, n, c, ct, eta), d + 2.0 * c * n
        if cut and thickness < PLATE * size:
            # Thin water on the glass: the ray leaves the water almost in the old direction.
            bent = d
        elif not cut and not sunk:
            # So do thin sheets and small lumps of water in the air.
            thick = ti.math.clamp(thickness / (LUMP * size), 0.0, 1.0)
            bent = ti.math.mix(d, bent, thick * thick).normalized()
        share, milk, white = reflectance(c, ct, eta), 0.0, vec3(0.0)
        if airy > 0.0:
            film = 1.0 - ti.exp(-thickness / (FILM * size))
            # Reflections vanish at the outline of the water.
            share, milk = share * film, MILK * bubbles * film
            white = MILK_SKY * (1.0 + n.dot(shot.up)) + MILK_SUN * (1.5 + n.dot(shot.sun))
        if sunk:
            if ct == 0.0:
                bent = mirrored
            bent, mirrored, thickness = mirrored, bent, FAR
            share = 1.0 - share
        else:
            share *= shot.reflection
        if straight:
            bent, share = d, 0.0
        rise = mirrored.dot(shot.up)
        if rise < 0.0 and not cut:  # would meet other waves: use the sky that they reflect
            mirrored -= 2.0 * rise * shot.up
        kind, under, sky, detail = 0, 0.0, vec3(0.0), False
        place, light, left, added = vec4(0.0), vec2(0.0), vec3(0.0), vec3(0.0)
        # First the ray in water, then the ray in air: a loop compiles the intersections once.
        for way in range(2):
            inwards = way == 0
            r = ti.select(inwards, bent, mirrored)
            to_sun = ti.select(inwards, shot.beam, shot.sun)
            s, axis, low = self.pool.exit_face(p, r, shot.size)
            # The reflected ray of a cut leaves the box or the container.
            way_out = ti.select(inwards or not cut, s, 0.0)
            t, body, n_body, close = MISSED, -1, vec3(0.0), False
            if ti.static(self.traits.bodies):
                wide = OUTLINE_REACH * SPAN * shot.pixel
                found = self.pool.bodies.intersect(p, r, way_out, reach, wide)
                t, body, n_body, close = found
            s = ti.min(s, t)
            q, through, deep, lit = p + r * s, vec3(0.0), 0.0, 1.0
            footprint = shot.pixel * (reach + s) / ti.max(abs(component(r, axis)), MIN_COSINE)
            if inwards:
                q, deep, path, bits = self.follow_refracted(p, q, r, s, cut, thickness, shot)
                if ti.static(self.traits.bodies):
                    if body >= 0 and bits == FOLDED:
                        q = self.pool.bodies.nearest(body, q)
                if straight:
                    deep = ti.max(self.sunlight.height(q, shot) - q.y, 0.0)
                through = transmittance(shot.absorption, path + DOWNWELLING * deep)
                lit = self.pool.sunlit(q, True, False)
                kind = axis + LOW * low + CUT * cut + bits + DETAIL * close
                kind += SUNK * sunk + STRAIGHT * straight
            lighting = self.pool.lighting(q, axis, low, to_sun, shot)
            seen = vec3(0.0)
            if body < 0 and shot.lid == 0 and q.y > shot.size.y:
                # Above the rim there are no tiles.
                if inwards:
                    kind += UNTILED - axis - LOW * low
                    seen = bilinear(self.backdrop.background, vec2(i, j) / COARSE)
                axis, low = 1, False
            if ti.static(self.traits.bodies):
                if body >= 0:
                    focus = 1.0
                    if inwards:
                        kind += UNTILED - axis - LOW * low + BODY * (1 + body)
                        focus = lit * self.sunlight.concentration(q, deep, shot)
                    seen, border = self.pool.bodies.shade(body, q, n_body, to_sun, focus, shot)
                    kind += DETAIL * border
            if inwards:
                place, under, left = vec4(q, footprint), deep, through
                light = lighting * vec2(lit, 1.0)
                added = shot.scatter * (1.0 - through) + through * seen
            else:
                sky, detail = self.reflected_light(q, r, axis, low, cut, lighting, footprint, shot)
                if body >= 0:
                    sky = seen
                detail = detail or close
        left, added = left * (1.0 - milk), ti.math.mix(added, white, milk)
        left, added = left * (1.0 - share), ti.math.mix(added, sky, share)
        if sunk:
            before, murk = transmittance(shot.absorption, reach), shot.scatter
            if shot.immersed == 1:
                murk *= self.daylight(ti.select(straight, place.xyz, p), shot)
            added += (murk - shot.scatter) * (1.0 - left) * straight
            left, added = left * before, ti.math.mix(murk, added, before)
        sample = make_sample(place, light, left, added, vec4(under, depth, 0.0, 0.0))
        return kind + DETAIL * detail, sample

    @ti.func
    def daylight(self, end, shot: ti.template()):
        """Returns the mean light, RGB, between the eye and a place under water, `end` [m], over the
        light at the surface: shafts of sunlight, darker with the depth."""
        light = vec3(0.0)
        for k in range(SHAFT_STEPS):
            q = ti.math.mix(shot.eye, end, (k + 0.5) / SHAFT_STEPS)
            deep = ti.max(self.sunlight.height(q, shot) - q.y, 0.0)
            sun = SHAFTS * self.sunlight.concentration(q, deep, shot) + 1.0 - SHAFTS
            light += sun * transmittance(shot.absorption, deep / DOWNWELLING)
        return light / SHAFT_STEPS

    @ti.func
    def back(self, i, j, shot: ti.template()):
        """Returns the depth [m] of the nearest back face at a pixel or, where a front face ends
        between two pixels, at one of its neighbours; FAR without any."""
        found = ti.bit_cast(self.raster.back[i, j], ti.f32)
        for k in range(ti.select(found == FAR, 4, 0)):
            a = ti.math.clamp(i + ti.select(k < 2, 2 * k - 1, 0), 0, shot.columns - 1)
            b = ti.math.clamp(j + ti.select(k < 2, 0, 2 * k - 5), 0, shot.rows - 1)
            found = ti.min(found, ti.bit_cast(self.raster.back[a, b], ti.f32))
        return found

    @ti.func
    def roughen(self, p, n, d, airy):
        """Returns the unit normal n at p [m] with the share `airy` (-) of the relief, facing the
        eye of the unit ray d, and the share of bubbles (-)."""
        relief = self.ripples.thin.relief.at(p)
        bent = n - airy * (relief.xyz - n * n.dot(relief.xyz))
        bent -= d * ti.max(bent.dot(d) + MIN_INCIDENCE, 0.0)
        return bent.normalized(), airy * ti.math.smoothstep(FOAMY[0], FOAMY[1], relief.w)

    @ti.func
    def hit_surface(self, i, j, d, shot: ti.template()):
        """Intersects the ray d of a pixel with the plane of its triangle, or, if the ray begins in
        water, with the side of the container or nothing (depth 0). Returns: depth [m]; normal out
        of the water; smooth normal towards the eye."""
        t = self.raster.item(i, j)
        depth, flat, n = 0.0, d.normalized(), -d.normalized()
        if t != self.raster.wet[None]:
            k = self.mesh.triangles[t]
            a = self.mesh.vertices[k[0]] - shot.eye
            b = self.mesh.vertices[k[1]] - shot.eye
            c = self.mesh.vertices[k[2]] - shot.eye
            flat = (b - a).cross(c - a)
            depth = a.dot(flat) / d.dot(flat)
            u, v, w = d.dot(b.cross(c)), d.dot(c.cross(a)), d.dot(a.cross(b))
            n = u * self.mesh.normals[k[0]] + v * self.mesh.normals[k[1]]
            n += w * self.mesh.normals[k[2]]
            # Front faces have negative weights: the sum points away from the eye.
            flat, n = flat.normalized(), -n.normalized()
        elif ti.static(self.traits.bodies):
            if self.pool.bodies.numbers.container[None] >= 0:
                depth = self.backdrop.faces.entry[i, j]
            if depth > 0.0:
                container = self.pool.bodies.numbers.container[None]
                n = -self.pool.bodies.normal(container, shot.eye + d * depth)
                flat = n
        return depth, flat, n

    @ti.func
    def follow_refracted(self, p, q, r, s, cut, thickness, shot: ti.template()):
        """Follows the refracted ray r from p through water to q, s [m] long. Returns its end [m],
        the depth of the end under water [m], the path through water [m], and bits of the kind. cut:
        p is on a wall; thickness: of the water along the eye ray [m]."""
        path, deep, bits = s, p.y - q.y, 0
        if cut or thickness < s:
            deep = self.sunlight.height(q, shot) - q.y
            if cut and r.y > 0.0 and deep < 0.0 and p.y < self.sunlight.height(p, shot):
                # The ray reaches the surface from below: total reflection folds it down.
                q.y = ti.math.clamp(q.y + 2.0 * deep, 0.0, shot.size.y)
                deep = -deep
                bits = FOLDED
            else:
                # After a crest or a drop, the ray may enter the water below.
                again = ti.max(deep, 0.0) / ti.max(abs(r.y), MIN_COSINE)
                path = ti.min(s, thickness + again)
                bits = LEFT_AGAIN
        return q, ti.max(deep, 0.0), path, bits

    @ti.func
    def reflected_light(self, q, r, axis, low, cut, light, footprint, shot: ti.template()):
        """Returns the radiance along the reflected ray r: of the tiled wall at q [m] under light
        (sun, sky), or of sky with the sun; and True if the sun's reflection is near. cut: the ray
        begins on a wall, outside."""
        colour, detail = vec3(0.0), False
        if not cut and self.pool.is_tiled(axis, low, shot):
            colour = self.pool.albedo(q, axis, footprint, shot)
            colour *= SUN_LIGHT * light.x + SKY_LIGHT * light.y
        else:
            sheen = ti.max(r.dot(shot.sun), 0.0)
            for _ in range(SHEEN_GLOSS):
                sheen *= sheen
            glint = sheen
            for _ in range(GLINT_GLOSS):
                glint *= glint
            sunny = ti.select(cut, 0.0, GLINT * glint + SHEEN * sheen)
            detail = not cut and sheen > NEAR_GLINT
            colour = self.pool.far_radiance(r, shot) + SUN * sunny
        return colour, detail
