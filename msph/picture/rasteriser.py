"""Rasterisation of triangles and spheres to a visibility buffer: the nearest item of each pixel.

An i32 per pixel holds depth (high bits) and item number (low bits), so that one `atomic_min` writes
both and the result does not depend on the order of threads. Depth bits only sort; exact depth and
normal are computed from the item.

Triangles use homogeneous edge functions (Olano and Greer 1997): with vertices a, b, c relative to
the eye and a pixel ray d of forward part 1, the barycentric weights are d.(b x c), d.(c x a) and
d.(a x b) over their sum, and 1 / depth = d.N / a.N with the triangle's normal N. No vertex is
divided by its depth, so triangles through the near plane need no clipping.

Where the eye is in the box or looks into a container, a ray may begin in water: it does if the
first face behind its start is a back face. Such pixels show a back face, or WET if the water
reaches up to the wall. Faces in front of a container's near side are clipped.
"""

import taichi as ti

from msph.launches import data_oriented
from msph.picture.room import PixelFields

BLOCK = 256  # pixels or items per block of GPU threads, or that a CPU thread takes in turn
KEY_BITS = 31
NO_ITEM = 0x7FFFFFFF  # key of a pixel without an item
FAR = 1e9  # depth of a pixel without a back face [m]
OVERLAP = 2e-3  # pixels by which triangles exceed their edges, against gaps
FRONT, ON_WALL = 1, 2  # lowest bits of a crossing: a front face; a face on a wall of the box


@data_oriented
class Rasteriser:
    """Visibility buffer of an image; `item_bits` of a key hold the item number.

    wet[None]: item WET. crossing: bits of the depth of the first face behind `entry`, with FRONT
    and ON_WALL; only valid in a frame that is clipped (draw_mesh).
    """

    def __init__(self, fields: PixelFields, lens):
        self.lens, self.key, self.back = lens, fields.key, fields.back
        self.crossing, self.entry = fields.crossing, fields.entry
        self.item_bits, self.wet = ti.field(ti.i32, ()), ti.field(ti.i32, ())

    @ti.func
    def clear(self, items):
        """Clears the buffer for item numbers below `items`."""
        self.wet[None] = items
        self.item_bits[None] = ti.max(1, 32 - ti.math.clz(ti.max(items, 1)))
        columns, rows = self.lens.shot[None].columns, self.lens.shot[None].rows
        ti.loop_config(block_dim=BLOCK)
        for i, j in ti.ndrange(columns, rows):
            self.key[i, j] = self.crossing[i, j] = NO_ITEM
            self.back[i, j] = ti.bit_cast(ti.f32(FAR), ti.i32)

    @ti.func
    def item(self, i, j):
        """Returns the item number of a pixel that shows an item."""
        return self.key[i, j] & ((1 << self.item_bits[None]) - 1)

    @ti.func
    def make_key(self, w, item, bits, shot: ti.template()):
        """Returns the sorting key of an item at inverse depth w [1/m]; bits: of the item number."""
        levels = ti.cast((1 << (KEY_BITS - bits)) - 2, ti.f32)
        x = ti.math.clamp((shot.w_near - w) / shot.w_span, 0.0, 1.0)
        return (ti.cast(x * levels, ti.i32) << bits) | item

    @ti.func
    def offer(self, i, j, key):
        if key < self.key[i, j]:  # a plain read first: most offers lose
            ti.atomic_min(self.key[i, j], key)

    @ti.func
    def bounds(self, lo, hi, shot: ti.template()):
        """Clips a rectangle of pixel coordinates to the pixels [i0, j0, i1, j1] of the image."""
        first = ti.cast(ti.ceil(ti.max(lo, 0.0)), ti.i32)
        corner = ti.Vector([shot.columns - 1.0, shot.rows - 1.0])
        last = ti.cast(ti.floor(ti.min(hi, corner)), ti.i32)
        return ti.Vector([first.x, first.y, last.x, last.y])

    @ti.func
    def triangle_bounds(self, a, b, c, shot: ti.template()):
        """Returns the bounds of the pixels that a triangle (relative to the eye) may cover: all
        pixels if it crosses the near plane."""
        za, zb, zc = a.dot(shot.forward), b.dot(shot.forward), c.dot(shot.forward)
        lo, hi = ti.Vector([0.0, 0.0]), ti.Vector([shot.columns - 1.0, shot.rows - 1.0])
        near = 1.0 / shot.w_near
        if ti.min(za, zb, zc) > 0.5 * near:
            ra, rb, rc = 1.0 / za, 1.0 / zb, 1.0 / zc
            pa = ti.Vector([a.dot(shot.to_i), a.dot(shot.to_j)]) * ra
            pb = ti.Vector([b.dot(shot.to_i), b.dot(shot.to_j)]) * rb
            pc = ti.Vector([c.dot(shot.to_i), c.dot(shot.to_j)]) * rc
            lo = ti.min(pa, pb, pc) + shot.centre - OVERLAP
            hi = ti.max(pa, pb, pc) + shot.centre + OVERLAP
        elif ti.max(za, zb, zc) < near:
            hi = ti.Vector([-1.0, -1.0])
        return self.bounds(lo, hi, shot)

    @ti.func
    def draw_mesh(self, mesh: ti.template(), contained):
        """Draws front faces into `key`, and back faces that are not on walls into `back`. The frame
        is clipped if it looks into a container (contained: 1) or from within the box; see the
        module docstring."""
        ti.loop_config(block_dim=BLOCK)
        for t in range(mesh.counts[1]):
            shot = self.lens.shot[None]
            k = mesh.triangles[t]
            pa, pb, pc = mesh.vertices[k[0]], mesh.vertices[k[1]], mesh.vertices[k[2]]
            a, b, c = pa - shot.eye, pb - shot.eye, pc - shot.eye
            n = (b - a).cross(c - a)
            volume = a.dot(n)
            front, wall, clipped = volume < 0.0, False, contained + shot.immersed > 0
            if volume > 0.0:
                wall = on_wall(pa, pb, pc, shot)
            if front or (volume > 0.0 and (clipped or not wall)):
                kind = FRONT * front + ON_WALL * wall
                self.fill(t, ti.Matrix.rows([a, b, c]), n, volume, kind, contained, shot)

    @ti.func
    def fill(self, t, corners, n, volume, kind, contained, shot: ti.template()):
        """Writes a triangle to the pixels that it covers. corners: rows, relative to the eye [m];
        kind: FRONT and ON_WALL."""
        a, b, c = corners[0, :], corners[1, :], corners[2, :]
        front = kind & FRONT != 0
        box = self.triangle_bounds(a, b, c, shot)
        if box[0] <= box[2] and box[1] <= box[3]:
            s = ti.select(front, -1.0, 1.0)
            edges = ti.Matrix.rows([b.cross(c) * s, c.cross(a) * s, a.cross(b) * s])
            e0, ei, ej = edges @ shot.origin, edges @ shot.du, edges @ shot.dv
            e0 += OVERLAP * (abs(ei) + abs(ej))
            w_scale, bits = 1.0 / volume, self.item_bits[None]
            w0 = shot.origin.dot(n) * w_scale
            wi, wj = shot.du.dot(n) * w_scale, shot.dv.dot(n) * w_scale
            for i in range(box[0], box[2] + 1):
                for j in range(box[1], box[3] + 1):
                    e = e0 + ei * i + ej * j
                    w = w0 + wi * i + wj * j
                    if e.min() >= 0.0 and w > 0.0 and w <= shot.w_near:
                        begin = self.begin(i, j, contained)
                        if begin * w <= 1.0:
                            if contained + shot.immersed > 0:
                                z = ti.bit_cast(1.0 / w, ti.i32) & ~(FRONT | ON_WALL)
                                ti.atomic_min(self.crossing[i, j], z | kind)
                            if front or (kind == 0 and shot.immersed == 1 and begin == 0.0):
                                self.offer(i, j, self.make_key(w, t, bits, shot))
                            if kind == 0:
                                ti.atomic_min(self.back[i, j], ti.bit_cast(1.0 / w, ti.i32))

    @ti.func
    def begin(self, i, j, contained):
        """Returns the depth [m] from which a pixel's ray can meet water."""
        found = 0.0
        if contained == 1:
            found = self.entry[i, j]
        return found

    @ti.func
    def mark_wet(self, contained):
        """Sets the item WET in a clipped frame, after draw_mesh()."""
        clipped = ti.max(contained, self.lens.shot[None].immersed)
        columns, rows = clipped * self.lens.shot[None].columns, self.lens.shot[None].rows
        ti.loop_config(block_dim=BLOCK)
        for i, j in ti.ndrange(columns, rows):
            shot, first = self.lens.shot[None], self.crossing[i, j]
            begin = self.begin(i, j, contained)
            if first & FRONT == 0 and (begin > 0.0 or first & ON_WALL != 0):
                w = 1.0 / ti.max(begin, 1.0 / shot.w_near)
                self.key[i, j] = self.make_key(w, self.wet[None], self.item_bits[None], shot)

    @ti.func
    def project(self, c, shot: ti.template()):
        """Returns pixel coordinates (right, up) and depth [m] of a point c [m] relative to the eye;
        the coordinates are valid for positive depths."""
        z = c.dot(shot.forward)
        at = ti.Vector([c.dot(shot.to_i), c.dot(shot.to_j)]) / z + shot.centre
        return ti.math.vec3(at.x, at.y, z)

    @ti.func
    def draw_spheres(self, n, x: ti.template(), radius: ti.template()):
        """Draws the front of spheres at x [m] with radii `radius` [m] into `key`."""
        ti.loop_config(block_dim=BLOCK)
        for p in range(n):
            shot, bits = self.lens.shot[None], self.item_bits[None]
            c = x[p] - shot.eye
            r = radius[p]
            z = c.dot(shot.forward)
            # A radius of zero hides a sphere.
            if r > 0.0 and z - r > 1.0 / shot.w_near:
                rz = 1.0 / z
                m = ti.Vector([c.dot(shot.to_i), c.dot(shot.to_j)]) * rz
                m += shot.centre
                # Off the axis the projection is an ellipse, longer by at most 1 / cos.
                reach = r / (shot.pixel * (z - r)) * c.norm() * rz
                box = self.bounds(m - reach, m + reach, shot)
                for i in range(box[0], box[2] + 1):
                    for j in range(box[1], box[3] + 1):
                        w = sphere_inverse_depth(c, r, shot.origin + shot.du * i + shot.dv * j)
                        if w > 0.0:
                            self.offer(i, j, self.make_key(w, p, bits, shot))


@ti.func
def sphere_inverse_depth(c, r, d):
    """Returns 1 / depth at which the ray d (forward part 1) from the eye meets a sphere; 0: a miss.

    |s d - c| = r, nearer root: s = (c.c - r^2) / (d.c + sqrt((d.c)^2 - d.d (c.c - r^2))).
    """
    dc, q = d.dot(c), c.dot(c) - r * r
    disc = dc * dc - d.dot(d) * q
    w = 0.0
    if disc >= 0.0 and dc > 0.0:
        w = (dc + ti.sqrt(disc)) / q
    return w


@ti.func
def walls_of(shot: ti.template()):
    """Returns the coordinates [m] of the far walls; without a lid, the top is far away."""
    return shot.size + ti.math.vec3(0.0, FAR * (1 - shot.lid), 0.0)


@ti.func
def on_wall(a, b, c, shot: ti.template()):
    """Returns True if a triangle is on a face of the box, within the shot's skin."""
    lo, hi = ti.max(a, b, c), ti.min(a, b, c)
    return lo.min() < shot.skin or (walls_of(shot) - hi).min() < shot.skin
