"""Rasterisation of triangles and spheres to a visibility buffer: the nearest item of each pixel.

An i32 per pixel holds depth (high bits) and item number (low bits), so that one `atomic_min` writes
both and the result does not depend on the order of threads. Depth bits only sort; exact depth and
normal are computed from the item.

Triangles use homogeneous edge functions (Olano and Greer 1997): with the corners' homogeneous
image coordinates a, b, c = z (x, y, 1) and a pixel p = (x, y, 1), the barycentric weights over z
are p.(b x c), p.(c x a) and p.(a x b), each over a.(b x c); 1 / depth is their sum. No vertex is
divided by its depth, so triangles through the near plane need no clipping.

Where the eye is in the box or looks into a container, a ray may begin in water: it does if the
first face behind its start is a back face. Such pixels show a back face, or WET if the water
reaches up to the wall. Faces in front of a container's near side are clipped.
"""

import taichi as ti

from msph.launches import data_oriented
from msph.picture.room import PixelFields
from msph.picture.samples import CPU_BLOCKS, GPU_BLOCKS, SPAN, strip_length, strips
from msph.picture.shot import ray
from msph.taichi_internals import on_cpu

BLOCK = 256  # pixels or items per block of GPU threads, or that a CPU thread takes in turn
KEY_BITS = 31
DEPTH_STEP = int(1e-3 * 2**KEY_BITS)  # keys from crest to trough: 0.001 of the range
NO_ITEM = 0x7FFFFFFF  # key of a pixel without an item
FAR = 1e9  # depth of a pixel without a back face [m]
OVERLAP = 2e-3  # pixels by which triangles exceed their edges, against gaps
# Lowest bits of a crossing: a front face; a face on a wall of the box. The kind of a face has
# another bit: there is a container.
FRONT, ON_WALL, CONTAINED = 1, 2, 4


@data_oriented
class Rasteriser:
    """Visibility buffer of an image; `item_bits` of a key hold the item number.

    wet[None]: item WET. crossing: bits of the depth of the first face behind `entry`, with FRONT
    and ON_WALL; only valid in a frame that is clipped (draw_mesh).
    """

    def __init__(self, fields: PixelFields, lens):
        self.lens, self.key, self.back = lens, fields.key, fields.back
        self.crossing, self.entry = fields.crossing, fields.entry
        self.strip, self.block = strip_length(), CPU_BLOCKS if on_cpu() else GPU_BLOCKS
        self.item_bits, self.wet = ti.field(ti.i32, ()), ti.field(ti.i32, ())

    @ti.func
    def clear(self, items):
        """Clears the buffer for item numbers below `items`, where the shot may show any."""
        self.wet[None] = items
        self.item_bits[None] = ti.max(1, 32 - ti.math.clz(ti.max(items, 1)))
        first, last = self.lens.shot[None].first, self.lens.shot[None].last
        ti.loop_config(block_dim=self.block)
        for i, s in ti.ndrange((first.x, last.x), strips(last.y - first.y, self.strip)):
            low = first.y + s * self.strip
            for j in range(low, ti.min(low + self.strip, last.y)):
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
    def inverse_depth(self, key, bits, shot: ti.template()):
        """Returns the inverse depth [1/m] of a key of make_key()."""
        levels = ti.cast((1 << (KEY_BITS - bits)) - 2, ti.f32)
        return shot.w_near - ((key >> bits) + 0.5) / levels * shot.w_span

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
    def homogeneous(self, c, shot: ti.template()):
        """Returns z (x, y, 1) of a point c [m] relative to the eye: z its depth [m], x and y in
        pixels from the view axis."""
        return ti.math.vec3(c.dot(shot.to_i), c.dot(shot.to_j), c.dot(shot.forward))

    @ti.func
    def project(self, c, shot: ti.template()):
        """Returns pixel coordinates (right, up) and depth [m] of a point c [m] relative to the eye;
        the coordinates are valid for positive depths."""
        h = self.homogeneous(c, shot)
        return ti.math.vec3(h.xy / h.z + shot.centre, h.z)

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
            volume = a.dot((b - a).cross(c - a))
            front, wall, clipped = volume < 0.0, False, contained + shot.immersed > 0
            if volume > 0.0:
                wall = on_wall(pa, pb, pc, shot)
            if front or (volume > 0.0 and (clipped or not wall)):
                kind = FRONT * front + ON_WALL * wall + CONTAINED * contained
                self.fill(ti.Matrix.rows([a, b, c]), t, kind, self, shot)

    @ti.func
    def fill(self, corners, item, kind, target: ti.template(), shot: ti.template()):
        """Offers the pixels that a triangle covers to `target`, an object with a function put(i, j,
        1 / depth, item, kind, shot). corners: rows, relative to the eye [m]."""
        a = self.homogeneous(corners[0, :], shot)
        b = self.homogeneous(corners[1, :], shot)
        c = self.homogeneous(corners[2, :], shot)
        near = 1.0 / shot.w_near
        if ti.max(a.z, b.z, c.z) >= near:
            lo, hi = ti.cast(shot.first, ti.f32), shot.last - 1.0
            # A triangle that crosses the near plane may cover all pixels.
            if ti.min(a.z, b.z, c.z) > 0.5 * near:
                pa, pb, pc = a.xy / a.z, b.xy / b.z, c.xy / c.z
                lo = ti.max(lo, ti.min(pa, pb, pc) + shot.centre - OVERLAP)
                hi = ti.min(hi, ti.max(pa, pb, pc) + shot.centre + OVERLAP)
            box = self.bounds(lo, hi, shot)
            if box[0] <= box[2] and box[1] <= box[3]:
                h = ti.Matrix.rows([a, b, c])
                scan(h, ti.math.vec3(1.0), box, shot.centre, item, kind, target, shot)

    @ti.func
    def put(self, i, j, w, t, kind, shot: ti.template()):
        """Writes a pixel of triangle t, 1 / w [m] away. kind: FRONT, ON_WALL and CONTAINED."""
        if w > 0.0 and w <= shot.w_near:
            contained, side = kind & CONTAINED != 0, kind & ~CONTAINED
            begin = self.begin(i, j, contained)
            if begin * w <= 1.0:
                if contained or shot.immersed == 1:
                    z = ti.bit_cast(1.0 / w, ti.i32) & ~(FRONT | ON_WALL)
                    ti.atomic_min(self.crossing[i, j], z | side)
                if side & FRONT != 0 or (side == 0 and shot.immersed == 1 and begin == 0.0):
                    self.offer(i, j, self.make_key(w, t, self.item_bits[None], shot))
                if side == 0:
                    ti.atomic_min(self.back[i, j], ti.bit_cast(1.0 / w, ti.i32))

    @ti.func
    def begin(self, i, j, contained):
        """Returns the depth [m] from which a pixel's ray can meet water."""
        found = 0.0
        if contained:
            found = self.entry[i, j]
        return found

    @ti.func
    def mark_wet(self, contained):
        """Sets the item WET in a clipped frame, after draw_mesh()."""
        clipped = ti.max(contained, self.lens.shot[None].immersed)
        first, last = self.lens.shot[None].first, self.lens.shot[None].last
        end = ti.select(clipped == 1, last.x, first.x)
        ti.loop_config(block_dim=BLOCK)
        for i, j in ti.ndrange((first.x, end), (first.y, last.y)):
            shot, crossing = self.lens.shot[None], self.crossing[i, j]
            begin = self.begin(i, j, contained == 1)
            if crossing & FRONT == 0 and (begin > 0.0 or crossing & ON_WALL != 0):
                w = 1.0 / ti.max(begin, 1.0 / shot.w_near)
                self.key[i, j] = self.make_key(w, self.wet[None], self.item_bits[None], shot)

    @ti.func
    def draw_spheres(self, n, x: ti.template(), radius: ti.template()):
        """Draws the front of spheres at x [m] with radii `radius` [m] into `key`."""
        ti.loop_config(block_dim=BLOCK)
        for p in range(n):
            shot, bits = self.lens.shot[None], self.item_bits[None]
            c, r = x[p] - shot.eye, radius[p]
            box = self.around(c, r, 1.0 / shot.w_near, shot)
            for i in range(box[0], box[2] + 1):
                for j in range(box[1], box[3] + 1):
                    w = sphere_inverse_depth(c, r, ray(i, j, shot))
                    if w > 0.0:
                        self.offer(i, j, self.make_key(w, p, bits, shot))

    @ti.func
    def around(self, c, r, least, shot: ti.template()):
        """Returns the pixels [i0, j0, i1, j1] around a sphere at c from the eye [m], none if its
        radius r is 0 or if it is nearer than the depth `least` [m]."""
        m, box = self.project(c, shot), ti.Vector([0, 0, -1, -1])
        if r > 0.0 and m.z - r > least:
            # Off the axis the projection is an ellipse, longer by at most 1 / cos.
            reach = r / (shot.pixel * (m.z - r)) * c.norm() / m.z
            box = self.bounds(m.xy - reach, m.xy + reach, shot)
        return box


@ti.func
def scan(corners, values, box, centre, item, kind, target: ti.template(), shot: ti.template()):
    """Offers the pixels [i0, j0, i1, j1] = box that a triangle covers to target.put(i, j, value,
    item, kind, shot). corners: rows, homogeneous image coordinates relative to the pixel
    `centre`; values: of the corners, interpolated like 1 / depth."""
    a, b, c = corners[0, :], corners[1, :], corners[2, :]
    ea, eb, ec = b.cross(c), c.cross(a), a.cross(b)
    volume = a.dot(ea)
    # Distances of the corners from the opposite edges [pixels], times their z. A thinner triangle
    # is between neighbours that overlap, and beyond its corners its edges would overlap far away.
    heights = abs(volume) / (ti.Vector([ea.xy.norm(), eb.xy.norm(), ec.xy.norm()]) + 1e-30)
    if (heights > 2.0 * OVERLAP * corners[:, 2]).all():
        s = ti.select(volume < 0.0, -1.0, 1.0)
        edges = ti.Matrix.rows([s * ea, s * eb, s * ec])
        ei, ej = edges[:, 0], edges[:, 1]
        e0 = edges[:, 2] - ei * centre.x - ej * centre.y + OVERLAP * (abs(ei) + abs(ej))
        g = (ea * values.x + eb * values.y + ec * values.z) / volume
        g0 = g.z - g.x * centre.x - g.y * centre.y
        for i in range(box[0], box[2] + 1):
            for j in range(box[1], box[3] + 1):
                if (e0 + ei * i + ej * j).min() >= 0.0:
                    target.put(i, j, g0 + g.x * i + g.y * j, item, kind, shot)


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


@ti.func
def smooth(key: ti.template(), i0, j0, columns, rows, mask):
    """Returns the least key of the block of pixels from (i0, j0) on, and if the keys of a
    visibility buffer have no steps of depth there, and equal bits of `mask`."""
    # One loop of constant length, which repeats pixels at the edge of the image: nested loops with
    # variable bounds take five times as long to compile.
    first, nearest, farthest, mixed = key[i0, j0], NO_ITEM, 0, 0
    for k in range(SPAN * SPAN):
        found = key[ti.min(i0 + k // SPAN, columns - 1), ti.min(j0 + k % SPAN, rows - 1)]
        nearest, farthest = ti.min(nearest, found), ti.max(farthest, found)
        mixed |= (found ^ first) & mask
    even = farthest != NO_ITEM and mixed == 0
    if even:
        # On a plane, the nearest and the farthest pixel are corners.
        near, far = NO_ITEM, 0
        for k in range(4):
            i = ti.min(i0 + SPAN * (k // 2), columns - 1)
            j = ti.min(j0 + SPAN * (k % 2), rows - 1)
            near, far = ti.min(near, key[i, j]), ti.max(far, key[i, j])
        slack = DEPTH_STEP + (far - near) // 2
        even = far != NO_ITEM and near - nearest < slack and farthest - far < slack
    return nearest, even
