"""Images: the walls of the box and the faces of bodies mirror the particles near them.

Images fill the part of a kernel beyond a wall or face: particles there have bulk density, pressures
balance, and images move with the reflected velocity. Images are not stored as particles. Image s of
particle j, seen by particle i, is an entry (j, g, back): the derivatives of its contribution to c_i
by x_i and by x_j. For a neighbour back = -g, for an image in a wall back = -R g with the mirror R.
Operators use entries of neighbours and images alike (docs/method.md, "One entry").

An image in walls is never nearer to i than its particle j, so the images within reach are found
among the neighbours. Walls of constant density (the kernel's integral behind a plane) transmit only
half of the pressure force (docs/trials.md, "Walls and bodies").

Beyond a plane face particle j has an image at the distance sqrt(r_ij^2 + 4 s_i s_j) from particle
i, s the distances from the face. The same distance serves for any face: it depends on the two
particles and the body only, as a potential between them would, so exact gradients conserve momentum
and angular momentum and keep the pressure operator symmetric. The image adds sqrt(a_i a_j) V_j W to
c_i; a, the ratio of the body's share of the kernel to that of a plane, accounts for curvature,
edges and thin bodies. Images of particles in walls have images in bodies, too, and images of bodies
in walls have images of particles.
"""

import math

import taichi as ti

from msph.errors import BlowUpError
from msph.fluid.boundary.body_shapes import BEGIN
from msph.fluid.part import Part, Parts
from msph.fluid.particles import kernels
from msph.fluid.particles.layers import LayerSpec
from msph.fluid.particles.neighbour_list import PARTICLES_PER_THREAD, max_mean_neighbours
from msph.fluid.particles.particles import Attribute
from msph.launches import data_oriented, heavy_kernel
from msph.taichi_internals import on_cpu

vec2, vec3 = ti.math.vec2, ti.math.vec3

ATTRIBUTES = (
    Attribute("first_image", "-", "first image", integer=True, carried=False),
    Attribute("body_image", "-", "first image in bodies", integer=True, carried=False),
    Attribute("image_end", "-", "end of the images", integer=True, carried=False),
    Attribute("body_share", "-", "contribution of bodies to c", carried=False),
)

# Numbers (f32 or i32) per image.
WORDS = 13
# Places beyond those counted: _store() writes one, and rounding may let it find another.
SPARE = 2
# Least number of places that a CPU thread reserves at a time.
CHUNK = 512
# Least length (-) of the mean of two normals that has a direction.
MIN_LENGTH = 1e-6

# Particle i at x [m], its layer, the walls near it and the openings near it, as bits.
Viewer = ti.types.struct(i=ti.i32, layer=ti.i32, walls=ti.i32, openings=ti.i32, x=vec3)
# Image in a body seen by a link: the particle's link, -1 if there is none; the bits of its mirrors,
# without those of the body; r [m] from the mirrored particle; squared distance [m^2] of the image.
BodyImage = ti.types.struct(partner=ti.i32, rest=ti.i32, r=vec3, r2=ti.f32)


@data_oriented
class Images(Part):
    """Images of particles, found by refresh().

    Tables by image, contiguous for a particle i, those in walls before those in bodies: index,
    particle j; mirrors, the walls that mirror it, as bits, except walls that mirror the body;
    gradient g and reaction `back` [1/m], set by Density for images in walls; arm [m], from the
    image to i; link, the link of i, -1 for images in walls; partner, the link of j, unset for
    images in walls.
    """

    def __init__(self, parts: Parts):
        super().__init__(parts)
        self.capacity = parts.room.images
        self.index, self.mirrors, self.link, self.partner = (
            ti.field(ti.i32, shape=self.capacity) for _ in range(4)
        )
        self.gradient, self.reaction, self.arm = (
            ti.Vector.field(3, ti.f32, shape=self.capacity) for _ in range(3)
        )
        self.found = ti.field(ti.i32, shape=())  # places of the tables that threads have reserved
        self.counted = not on_cpu()
        self.per_thread, self.chunk = (1, 0) if self.counted else (PARTICLES_PER_THREAD, CHUNK)
        self.opened = False  # True if walls have openings

    def refresh(self) -> None:
        """Finds links and images. The neighbour list must be fresh. Raises BlowUpError if there
        are more than fit."""
        if self.traits.bodies:
            self.links.find()
        found = self._find(self.particles.count, self.opened)
        if found > self.capacity:
            raise BlowUpError(
                f"walls and bodies mirror particles in {found:,} places, "
                f"at most {self.capacity:,} fit"
            )

    @heavy_kernel
    def _find(self, n: ti.i32, opened: ti.template()) -> ti.i32:
        """Finds the images; returns the number of reserved places, more than the capacity if the
        images do not fit."""
        self.found[None] = 0
        p = self.particles
        for begin in range(n):
            if begin % self.per_thread == 0:
                place, limit = 0, 0
                for i in range(begin, ti.min(begin + self.per_thread, n)):
                    viewer, share = self._viewer(i, opened), 0.0
                    most = self._most(viewer, opened)
                    if place + most > limit:
                        size = ti.max(most, self.chunk)
                        place = ti.atomic_add(self.found[None], size)
                        limit = place + size
                    fits = limit <= self.capacity
                    p.first_image[i] = place
                    if fits and most > 0:
                        for way in range(1, self.walls.combinations(viewer.walls)):
                            self._store(viewer, way, opened, place)
                    p.body_image[i] = place
                    if ti.static(self.traits.bodies):
                        for link in range(p.first_link[i], p.first_link[i] + p.links[i]):
                            if fits:
                                self._store_in_body(viewer, link, place, share)
                    p.image_end[i], p.body_share[i] = place, share
        return self.found[None]

    @ti.func
    def _most(self, viewer, opened: ti.template()):
        """Returns an upper bound of the number of images, and of SPARE more. A GPU counts those in
        walls; a CPU thread uses what is left for its next particle."""
        i = viewer.i
        entries, found = self.neighbours.end[i] - self.neighbours.start[i] + 1, 0
        for way in range(1, self.walls.combinations(viewer.walls)):
            mirrors = self.walls.combination(way, viewer.walls)
            mirror, wall = self.walls.mirror_and_wall(mirrors)
            if self._meets(viewer, mirror, wall):
                if ti.static(self.counted):
                    found += self._sees(viewer, i, mirrors, mirror, wall, opened)
                    for s in range(self.neighbours.start[i], self.neighbours.end[i]):
                        j = self.neighbours.index[s]
                        found += self._sees(viewer, j, mirrors, mirror, wall, opened)
                else:
                    found += entries
        if ti.static(self.traits.bodies):
            found += self.particles.links[i] * (entries + found)
        return ti.select(found > 0, found + SPARE, 0)

    @ti.func
    def _viewer(self, i, opened: ti.template()):
        """Returns particle i with the walls and openings near it."""
        x, layer = self.particles.x[i], self.particles.layer[i]
        reach, openings = self.neighbours.max_reach[layer], 0
        walls = self.walls.near(x, reach)
        if ti.static(opened):
            walls &= ~self.apertures.beyond(x)
            openings = self.apertures.near(x, reach)
        return Viewer(i=i, layer=layer, walls=walls, openings=openings, x=x)

    @ti.func
    def _sees(self, viewer, j, mirrors, mirror, wall, opened: ti.template()):
        """Returns 1 if the image of j by walls is within reach and visible, otherwise 0. Viewer and
        j must both be mirrored: forces between two particles must be equal and opposite."""
        x_j = self.particles.x[j]
        reach = self.neighbours.reaches[viewer.layer, self.particles.layer[j]]
        near = self.walls.offset(viewer.x, x_j, mirror, wall).norm_sqr() < reach * reach
        near = near and self.walls.is_mirrored(x_j)
        if ti.static(opened):
            near = near and self.apertures.visible(viewer.x, x_j, mirrors, viewer.openings)
        return ti.select(near, 1, 0)

    @ti.func
    def _meets(self, viewer, mirror, wall):
        """Returns True if the edge or corner of a combination of walls is within reach: all images
        by it are farther away."""
        way = 0.5 * (1.0 - mirror) * (viewer.x - wall)
        return way.norm_sqr() < self.neighbours.max_reach[viewer.layer] ** 2

    @ti.func
    def _store(self, viewer, way, opened: ti.template(), place: ti.template()):
        """Stores the images by one combination of walls from `place` on, which it advances. Each
        particle is written to the next place, which advances only if its image is seen: a branch
        would be mispredicted."""
        i, mirrors, first = viewer.i, self.walls.combination(way, viewer.walls), place
        mirror, wall = self.walls.mirror_and_wall(mirrors)
        if self._meets(viewer, mirror, wall):
            self.index[place] = i
            place += self._sees(viewer, i, mirrors, mirror, wall, opened)
            for s in range(self.neighbours.start[i], self.neighbours.end[i]):
                j = self.neighbours.index[s]
                self.index[place] = j
                place += self._sees(viewer, j, mirrors, mirror, wall, opened)
        for s in range(first, place):
            x_j = self.particles.x[self.index[s]]
            self.mirrors[s], self.link[s] = mirrors, -1
            self.arm[s] = self.walls.offset(viewer.x, x_j, mirror, wall)

    @ti.func
    def _store_in_body(self, viewer, link, place: ti.template(), share: ti.template()):
        """Stores the images that a link sees: of particle i itself, its neighbours, and its images
        in walls. Adds their contributions to c_i to `share`; sets the link's gradient G and torque
        T."""
        links, push, torque, i = self.links, vec3(0.0), vec3(0.0), viewer.i
        first, end = self.particles.first_image[i], self.particles.body_image[i]  # in walls
        start, count = self.neighbours.start[i], self.neighbours.end[i] - self.neighbours.start[i]
        for s in range(-1, count + end - first):
            j, mirrors = i, 0
            if s >= count:
                j, mirrors = self.index[first + s - count], self.mirrors[first + s - count]
            elif s >= 0:
                j = self.neighbours.index[start + s]
            if self.particles.links[j] > 0:
                image = self._body_image(viewer, link, j, mirrors)
                if image.partner >= 0:
                    self._store_entry(viewer, link, image, place, share, push, torque)
                    place += 1
        links.gradient[link], links.torque[link] = push, torque

    @ti.func
    def _body_image(self, viewer, link, j, mirrors):
        """Returns the image in a body that a link of particle i sees of j, or of the image of j in
        walls, some of which may mirror the body."""
        links, b, found = self.links, self.links.body[link], BodyImage(partner=-1)
        both = links.mirrors[link] ^ mirrors
        own = self.walls.by_walls(both, self.boundary.mirroring[b])
        # Images of images, by both walls of an axis, are out of reach.
        if ((both >> 3) & ~both & 7) == 0:
            first = self.particles.first_link[j]
            for k in range(first, first + self.particles.links[j]):
                if links.body[k] == b and links.mirrors[k] == own:
                    found.partner, found.rest = k, both ^ own
            if found.partner >= 0:
                mirror, wall = self.walls.mirror_and_wall(found.rest)
                centre = self.boundary.centre[b, BEGIN]
                x = self.walls.reflected(links.place[found.partner] + centre, mirror, wall)
                found.r = links.place[link] - (x - centre)
                product = links.distance[link] * links.distance[found.partner]
                found.r2 = found.r.norm_sqr() + 4.0 * product
                per_h = self.layers.per_h[viewer.layer, self.particles.layer[j]]
                if found.r2 * per_h**2 >= 1.0:
                    found.partner = -1
        return found

    @ti.func
    def _store_entry(
        self,
        viewer,
        link,
        image,
        s,
        share: ti.template(),
        push: ti.template(),
        torque: ti.template(),
    ):
        """Stores an image in a body, which a link of the viewer sees, as entry s; adds its
        contribution to c_i to `share`, and those to G and T of the link to `push` and `torque`."""
        links, k, layer = self.links, image.partner, viewer.layer
        j = links.particle[k]
        own = self._signs(links.mirrors[link])
        rest, rest_wall = self.walls.mirror_and_wall(image.rest)
        per_h, r = self.layers.per_h[layer, self.particles.layer[j]], ti.sqrt(image.r2)
        scale = self.layers.scale[layer, self.particles.layer[j]]
        self.link[s], self.partner[s] = link, k
        shape = self.factor(s) * scale * kernels.quartic_shape(r * per_h)
        w, slope = shape.x, shape.y * per_h * per_h
        repulsion, per_spacing = vec2(0.0), 1.0 / self.layers.spacing[layer]
        if k == link and image.rest == 0:
            repulsion = kernels.own_image(r * per_spacing)
            slope += repulsion.y * per_spacing / r
        n_i, n_j = links.normal[link], rest * links.normal[k]
        g = slope * (image.r + 2.0 * links.distance[k] * n_i) + 0.5 * w * links.slope[link]
        back = slope * (2.0 * links.distance[link] * n_j - image.r)
        back += 0.5 * w * rest * links.slope[k]
        share += w + repulsion.x
        push += g + back
        torque += links.place[link].cross(g) + (links.place[link] - image.r).cross(back)
        centre = self.boundary.centre[links.body[link], BEGIN]
        x = self.walls.reflected(links.place[k] + centre, rest, rest_wall)
        behind = 2.0 * links.distance[k] * n_i
        self.index[s], self.mirrors[s] = j, image.rest
        self.gradient[s] = own * g
        self.reaction[s] = self._signs(links.mirrors[k]) * rest * back
        self.arm[s] = own * (links.place[link] + centre - x + behind)

    @ti.func
    def signs(self, s):
        """Returns the factors (-1 or 1) by which the walls of image s mirror a vector."""
        return self._signs(self.mirrors[s])

    @ti.func
    def _signs(self, mirrors):
        return self.walls.mirror_and_wall(mirrors)[0]

    @ti.func
    def factor(self, s):
        """Returns the factor (-) of an image in a body, which accounts for the body's shape."""
        return ti.sqrt(self.links.ratio[self.link[s]] * self.links.ratio[self.partner[s]])

    @ti.func
    def place(self, i, s):
        """Returns the position [m] of image s, beyond a body along the normal at its particle."""
        found, links = self.particles.x[i] - self.arm[s], self.links
        if ti.static(self.traits.bodies):
            if self.link[s] >= 0:
                link, k = self.link[s], self.partner[s]
                bend = links.normal[link] - self.signs(s) * links.normal[k]
                found += 2.0 * links.distance[k] * self._signs(links.mirrors[link]) * bend
        return found

    @ti.func
    def mirrored(self, s, v):
        """Returns a vector of particle j as image s shows it to particle i."""
        found = self.signs(s) * v
        if ti.static(self.traits.bodies):
            if self.link[s] >= 0:
                found = self._reflection(s) @ v
        return found

    @ti.func
    def mirrored_stress(self, s, normal, shear):
        """Returns a symmetric matrix of particle j as image s shows it to particle i: its diagonal,
        and its yz, xz and xy components."""
        signs = self.signs(s)
        straight, aslant = normal, signs.x * signs.y * signs.z * signs * shear
        if ti.static(self.traits.bodies):
            if self.link[s] >= 0:
                mirror = self._reflection(s)
                m = mirror @ symmetric(normal, shear) @ mirror.transpose()
                straight = vec3(m[0, 0], m[1, 1], m[2, 2])
                aslant = vec3(m[1, 2], m[0, 2], m[0, 1])
        return straight, aslant

    @ti.func
    def _reflection(self, s):
        """Returns the matrix that mirrors vectors of image s in a body and in walls. The body
        mirrors at the mean of the two normals."""
        links, link, k, rest = self.links, self.link[s], self.partner[s], self.signs(s)
        there, here = rest * self._signs(links.mirrors[k]), self._signs(links.mirrors[link])
        n = (links.normal[link] + rest * links.normal[k]).normalized(MIN_LENGTH)
        plane = ti.Matrix.identity(ti.f32, 3) - 2.0 * n.outer_product(n)
        return here.outer_product(there) * plane


def image_capacity(
    size: tuple[float, float, float], specs: list[LayerSpec], count: int, bodies: bool
) -> int:
    """Returns the number of places for images of `count` particles in a region of `size` [m], from
    the bound of their neighbours at rest: particles within a kernel's reach of the walls take as
    many for images in walls (in a duct 3 spacings wide 0.92 times as many, with those that threads
    leave unused), and those at faces of bodies at most half as many for images in bodies. Without
    bodies: those of a sheet across a cube, for bodies that are added later."""
    x, y, z = size
    near = 2.0 * (x * y + y * z + z * x) * max(s.support / s.volume for s in specs)
    near_bodies = count if bodies else count ** (2.0 / 3.0)
    mean = max_mean_neighbours(specs, 0.0, "pair")
    return math.ceil((min(count, near) + 0.5 * near_bodies) * mean)


@ti.func
def symmetric(diagonal, others):
    """Returns the symmetric matrix of a diagonal and its yz, xz and xy components."""
    return ti.Matrix(
        [
            [diagonal.x, others.z, others.y],
            [others.z, diagonal.y, others.x],
            [others.y, others.x, diagonal.z],
        ]
    )
