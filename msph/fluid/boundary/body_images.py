"""Mirror images in bodies: the faces of bodies mirror the particles near them.

Beyond a plane face particle j has a mirror image, at the distance sqrt(r_ij^2 + 4 s_i s_j) from
particle i, s the distances from the face. The same distance serves for any face: it depends on the
two particles and the body only, as a potential between them would, so exact gradients conserve
momentum and angular momentum and keep the pressure operator symmetric. The image adds
sqrt(a_i a_j) V_j W to c_i; a, the ratio of the body's share of the kernel to that of a plane,
accounts for curvature, edges and thin bodies. Images of particles in walls have images in bodies,
too, and images of bodies in walls have images of particles (docs/method.md, "Walls and bodies").
"""

import taichi as ti

from msph.errors import BlowUpError
from msph.fluid.boundary.body_links import BodyLinks
from msph.fluid.boundary.body_shapes import BEGIN
from msph.fluid.particles import kernels
from msph.fluid.particles.mirror_images import INDEX_BITS
from msph.fluid.particles.neighbour_list import NeighbourList
from msph.fluid.room import Room
from msph.launches import data_oriented, heavy_kernel

vec2, vec3 = ti.math.vec2, ti.math.vec3

# Least length (-) of the mean of two normals that has a direction.
MIN_LENGTH = 1e-6

# An image of a particle seen by a link: the link of the particle, -1 if there is none; the bits of
# its mirrors, without and with those of the body; r [m] from the mirrored particle; squared
# distance [m^2] from its image in the body.
Image = ti.types.struct(partner=ti.i32, rest=ti.i32, r=vec3, r2=ti.f32)
# Sums over the images that particle i sees: share (-), gradient [1/m], inflow [1/s].
Contributions = ti.types.struct(share=ti.f32, gradient=vec3, inflow=ti.f32)


@data_oriented
class BodyImages:
    """Images of particles in bodies, found by refresh().

    Tables by image, contiguous for the links of a particle i: index, the entry of particle j and of
    the walls that mirror it but not the body (MirrorImages.entry); partner, the link of j; gradient
    and reaction [1/m], the derivatives of the image's contribution to c_i by x_i and x_j. By link:
    first, end, its images.
    """

    def __init__(self, room: Room, links: BodyLinks, neighbours: NeighbourList):
        self.links, self.boundary, self.particles = links, links.boundary, links.particles
        self.layers, self.neighbours, self.mirrors = links.layers, neighbours, neighbours.images
        self.capacity = room.images
        self.index, self.partner = (ti.field(ti.i32, shape=self.capacity) for _ in range(2))
        self.gradient, self.reaction = (
            ti.Vector.field(3, ti.f32, shape=self.capacity) for _ in range(2)
        )
        self.first, self.end = (ti.field(ti.i32, shape=links.capacity) for _ in range(2))
        self.found = ti.field(ti.i32, shape=())

    def refresh(self) -> None:
        """Finds links and images, and sets the bodies' share, gradient and inflow at the particles;
        these stay 0 without bodies. The neighbour list must be fresh. Raises BlowUpError if there
        are more than fit."""
        if not self.boundary.count:
            return
        self.links.find()
        found = self._find(self.particles.count)
        if found > self.capacity:
            raise BlowUpError(
                f"bodies mirror particles in {found:,} places, at most {self.capacity:,} fit"
            )

    @heavy_kernel
    def _find(self, n: ti.i32) -> ti.i32:
        """Finds the images; returns their number, of which those of a particle are stored if all of
        them fit."""
        self.found[None] = 0
        p = self.particles
        for i in range(n):
            count, begin, total = 0, 0, Contributions()
            first, end = p.first_link[i], p.first_link[i] + p.links[i]
            for link in range(first, end):
                for s in range(self.neighbours.start[i] - 1, self.neighbours.end[i]):
                    count += ti.select(self._image(i, link, s).partner >= 0, 1, 0)
            if count > 0:
                begin = ti.atomic_add(self.found[None], count)
            place, limit = begin, begin + count
            if limit <= self.capacity:
                for link in range(first, end):
                    self._store(i, link, limit, place, total)
            p.first_image[i], p.image_end[i] = begin, place
            p.boundary_share[i], p.boundary_gradient[i] = total.share, total.gradient
            p.boundary_inflow[i] = total.inflow
        return self.found[None]

    @ti.func
    def _image(self, i, link, s):
        """Returns the image that a link of particle i sees by an entry of the neighbour list, or of
        the particle itself by the entry before the first."""
        entry = i
        if s >= self.neighbours.start[i]:
            entry = self.neighbours.index[s]
        j, found, links = self.mirrors.neighbour(entry), Image(partner=-1), self.links
        if self.particles.links[j] > 0:
            both = links.mirrors[link] ^ (entry >> INDEX_BITS)
            b = links.body[link]
            own = self.mirrors.by_walls(both, self.boundary.images[b, BEGIN])
            # Images of images, by both walls of an axis, are out of reach.
            if ((both >> 3) & ~both & 7) == 0:
                first = self.particles.first_link[j]
                for k in range(first, first + self.particles.links[j]):
                    if links.body[k] == b and links.mirrors[k] == own:
                        found.partner, found.rest = k, both ^ own
                if found.partner >= 0:
                    mirror, wall = self.mirrors.mirror_and_wall(found.rest)
                    centre = self.boundary.centre[b, BEGIN]
                    x = self.mirrors.reflected(links.place[found.partner] + centre, mirror, wall)
                    found.r = links.place[link] - (x - centre)
                    product = links.distance[link] * links.distance[found.partner]
                    found.r2 = found.r.norm_sqr() + 4.0 * product
                    layer, other = self.particles.layer[i], self.particles.layer[j]
                    if found.r2 * self.layers.per_h[layer, other] ** 2 >= 1.0:
                        found.partner = -1
        return found

    @ti.func
    def _store(self, i, link, limit, place: ti.template(), total: ti.template()):
        """Stores the images of a link of particle i from `place` on, which it advances, and adds
        their contributions to `total`. An image at the end of the kernel may have been counted and
        not be found, or the reverse, by rounding: hence `limit`."""
        links, layer = self.links, self.particles.layer[i]
        self.first[link] = place
        own, _ = self.mirrors.mirror_and_wall(links.mirrors[link])
        push, torque = vec3(0.0), vec3(0.0)
        for s in range(self.neighbours.start[i] - 1, self.neighbours.end[i]):
            image = self._image(i, link, s)
            if image.partner >= 0 and place < limit:
                k = image.partner
                j = links.particle[k]
                other, rest = self.particles.layer[j], self._signs(image.rest)
                factor = self.factor(link, k)
                per_h, scale = self.layers.per_h[layer, other], self.layers.scale[layer, other]
                shape = factor * scale * kernels.quartic_shape(ti.sqrt(image.r2) * per_h)
                w, slope = shape.x, shape.y * per_h * per_h
                repulsion, per_spacing = vec2(0.0), 1.0 / self.layers.spacing[layer]
                if k == link and image.rest == 0:
                    r = ti.sqrt(image.r2)
                    repulsion = kernels.own_image(r * per_spacing)
                    slope += repulsion.y * per_spacing / r
                n_i, n_j = links.normal[link], rest * links.normal[k]
                g = slope * (image.r + 2.0 * links.distance[k] * n_i) + 0.5 * w * links.slope[link]
                back = slope * (2.0 * links.distance[link] * n_j - image.r)
                back += 0.5 * w * rest * links.slope[k]
                push += g + back
                x = links.place[link]
                torque += x.cross(g) + (x - image.r).cross(back)
                self.index[place] = self.mirrors.entry(j, image.rest)
                self.partner[place] = k
                self.gradient[place] = own * g
                self.reaction[place] = self._signs(links.mirrors[k]) * rest * back
                total.share += w + repulsion.x
                total.gradient += own * g
                place += 1
        self.end[link] = place
        links.gradient[link], links.torque[link] = push, torque
        total.inflow += links.inflow(link)

    @ti.func
    def particle(self, s):
        """Returns the particle of image s."""
        return self.mirrors.neighbour(self.index[s])

    @ti.func
    def _signs(self, mirrors):
        return self.mirrors.mirror_and_wall(mirrors)[0]

    @ti.func
    def arm(self, link, s):
        """Returns the vector [m] along which image s of a link presses, in the particle's frame,
        and the image's position [m]."""
        links, k = self.links, self.partner[s]
        centre = self.boundary.centre[links.body[link], BEGIN]
        mirror, wall = self.mirrors.mirror_and_wall(self.index[s] >> INDEX_BITS)
        x = self.mirrors.reflected(links.place[k] + centre, mirror, wall)
        behind = 2.0 * links.distance[k]
        own, far = self.mirrors.mirror_and_wall(links.mirrors[link])
        image = self.mirrors.reflected(x - behind * mirror * links.normal[k], own, far)
        return own * (links.place[link] + centre - x + behind * links.normal[link]), image

    @ti.func
    def factor(self, link, partner):
        """Returns the factor (-) of the image by two links, which accounts for the body's shape."""
        return ti.sqrt(self.links.ratio[link] * self.links.ratio[partner])

    @ti.func
    def reflection(self, link, s):
        """Returns the matrix that mirrors vectors of particle j in the body and the walls as
        particle i of a link sees them by image s. The body mirrors at the mean of the two
        normals."""
        links, k = self.links, self.partner[s]
        rest = self._signs(self.index[s] >> INDEX_BITS)
        there, here = rest * self._signs(links.mirrors[k]), self._signs(links.mirrors[link])
        n = (links.normal[link] + rest * links.normal[k]).normalized(MIN_LENGTH)
        plane = ti.Matrix.identity(ti.f32, 3) - 2.0 * n.outer_product(n)
        return here.outer_product(there) * plane
