"""Shapes, poses and distances of bodies, and their shares of kernels, for use in kernels.

Each body has a share lambda of the kernel's integral around a particle: for a block the product
over its axes, for a ball the exact integral, for a mesh a map computed once per layer (Bender et
al. 2019, "Volume maps", here with exact integrals). Its ratio to the share of a
plane scales the images of particles in the body's face (body_links.py).
"""

import taichi as ti

from msph.device_table import DeviceTable, f32, i32
from msph.fluid.boundary.sampled_fields import SampledFields
from msph.fluid.boundary.wall_integrals import ball_share, block_share
from msph.fluid.boundary.walls import NO_WALL, WALLS
from msph.fluid.constants import Constants
from msph.fluid.particles.layers import Layers
from msph.fluid.room import MAX_BODIES, Room

vec3, vec4 = ti.math.vec3, ti.math.vec4

BLOCK, BALL, SOLID = 0, 1, 2
# Interpolation of a mesh's distances: cubics make its sides smooth; B-splines also round its edges
# by a cell, which otherwise have bevels and ripples.
LINEAR, CUBIC, ROUND = 0, 1, 2
# Index of a body's pose: at the beginning and at the end of a step.
BEGIN, END = 0, 1


class BodyShapes:
    """Tables of the bodies, and functions of kernels on them; boundary.py fills the tables.

    Tables by body: kind; side, -1 if the water is inside, else 1; half, the half extents of a block
    or the radius of a ball [m]; bounding_radius [m]; first, index of a mesh's distance lattice,
    followed by its share lattices;
    joined, 1 for bodies that may overlap others; inverse_mass [1/kg], 0 for prescribed motion;
    friction coefficient (-); mirroring, the walls that mirror the body at BEGIN as bits
    (Walls.near). Tables by body and pose: centre [m]; rotation, body frame to box
    frame; velocity [m/s] and spin [rad/s], equal for both poses; inverse_inertia [1/(kg m^2)] in
    the box frame.
    """

    def __init__(self, room: Room, constants: Constants, layers: Layers):
        self.constants, self.layers = constants, layers
        self.support = layers.wall_support
        self._shapes = DeviceTable(
            (MAX_BODIES + 1,),
            **{"kind": i32, "side": f32, "half": vec3},
            **{"bounding_radius": f32, "first": i32},
            **{"joined": i32, "inverse_mass": f32, "friction": f32},
        )
        self._poses = DeviceTable(
            (MAX_BODIES + 1, 2),
            **{"centre": vec3, "rotation": ti.math.mat3, "velocity": vec3, "spin": vec3},
            **{"inverse_inertia": ti.math.mat3},
        )
        self._mirrors = DeviceTable((MAX_BODIES,), mirroring=i32)
        for table in (self._shapes, self._poses, self._mirrors):
            self.__dict__.update({name: getattr(table, name) for name in table.fields})
        self.samples = SampledFields(room.samples)

    @ti.func
    def to_body_frame(self, b, x, pose):
        """Returns x [m] in the frame of body b."""
        return self.rotation[b, pose].transpose() @ (x - self.centre[b, pose])

    @ti.func
    def distance(self, b, x, pose):
        """Returns the distance [m] of x from body b, positive in the water, and its gradient."""
        return self.distance_by(b, x, pose, LINEAR)

    @ti.func
    def normal(self, b, x, pose):
        """Returns the unit normal of body b near x [m], towards the water; smooth for meshes."""
        return self.distance_by(b, x, pose, CUBIC).yzw.normalized(1e-9)

    @ti.func
    def distance_by(self, b, x, pose, method: ti.template()):
        """Returns distance() with the interpolation `method` of meshes: LINEAR, CUBIC or ROUND."""
        found = self.own_distance(b, self.to_body_frame(b, x, pose), method)
        g = self.rotation[b, pose] @ found.yzw
        return vec4(found.x, g[0], g[1], g[2])

    @ti.func
    def own_distance(self, b, p, method: ti.template()):
        """Returns distance_by() at p [m]; p and the gradient are in the frame of body b."""
        found, kind = vec4(0.0), self.kind[b]
        if kind == BLOCK:
            found = block_distance(p, self.half[b])
        if kind == BALL:
            r = p.norm()
            n = p / ti.max(r, 1e-9)
            found = vec4(r - self.half[b][0], n[0], n[1], n[2])
        if kind == SOLID:
            if ti.static(method == LINEAR) or not self.samples.covers(self.first[b], p):
                found = self.mesh_distance(b, p)
            elif ti.static(method == CUBIC):
                found = self.samples.cubic(self.first[b], p)
            else:
                found = self.samples.spline(self.first[b], p)
        return self.side[b] * found

    @ti.func
    def mesh_distance(self, b, p):
        """Returns the distance from a mesh of p, in the mesh's frame, and its gradient.

        Outside the lattice it is a lower bound. With c the lattice point nearest to p, |p - q|^2 >=
        |p - c|^2 + |c - q|^2 for all q of the mesh, since the lattice is convex.
        """
        m = self.first[b]
        found = self.samples.linear(m, p)
        gap = p - self.samples.clamped(m, p)
        if gap.norm_sqr() > 0.0:
            length = ti.sqrt(gap.norm_sqr() + found.x * found.x)
            n = (gap + found.x * found.yzw) / length
            found = vec4(length, n[0], n[1], n[2])
        return found

    @ti.func
    def clearance(self, x, pose):
        """Returns the distance [m] of x from the nearest body, negative inside."""
        found = 1e9
        for b in range(self.constants.bodies[None]):
            found = ti.min(found, self.distance(b, x, pose).x)
        return found

    @ti.func
    def near(self, b, x, reach, pose):
        """Returns distance(), or NO_WALL if body b is certainly farther than `reach` [m] from x.
        Numbers from -WALLS to -1 are the walls of the box, as planes."""
        found = vec4(NO_WALL, 0.0, 0.0, 0.0)
        if b >= 0:
            if self.reaches(b, x, reach, pose):
                found = self.distance(b, x, pose)
        else:
            walls = self.constants.walls[None]
            for k in ti.static(range(3)):
                if b == 2 * k - WALLS:
                    found[0], found[1 + k] = x[k], 1.0
                if b == 2 * k + 1 - WALLS:
                    found[0], found[1 + k] = walls[k] - x[k], -1.0
        return found

    @ti.func
    def reaches(self, b, x, h, pose):
        """Returns False if body b is certainly farther than h [m] from x."""
        reach = self.bounding_radius[b] + h
        return self.side[b] < 0.0 or (x - self.centre[b, pose]).norm_sqr() < reach * reach

    @ti.func
    def joint_share(self, b, x, layer, h):
        """Returns body_share() at the beginning of a step, without what joined bodies before b
        cover: the shares of joined bodies add up to that of their union."""
        found = self.body_share(b, x, layer, h, BEGIN)
        if self.joined[b] == 1:
            for other in range(b):
                if self.joined[other] == 1:
                    covered = self.body_share(other, x, layer, h, BEGIN)
                    slope = (1.0 - covered.x) * found.yzw - found.x * covered.yzw
                    free = (1.0 - covered.x) * found.x
                    found = vec4(free, slope[0], slope[1], slope[2])
        return found

    @ti.func
    def open_share(self, x, layer, pose):
        """Returns the share (-) of a layer's kernel outside all bodies and its gradient [1/m]."""
        free, slope = 1.0, vec3(0.0)
        h = self.support[layer]
        for b in range(self.constants.bodies[None]):
            part = self.body_share(b, x, layer, h, pose)
            slope = slope * (1.0 - part.x) - free * part.yzw
            free *= 1.0 - part.x
        return vec4(free, slope[0], slope[1], slope[2])

    @ti.func
    def meets_kernel(self, b, p, layer, h):
        """Returns False if lambda of body b has no gradient at p [m], in the frame of b; h [m]:
        support of the kernel."""
        half, kind, found = self.half[b], self.kind[b], False
        if kind == BLOCK:
            found = (abs(p) < half + h).all()
        if kind == BALL:
            found = p.norm() < half[0] + h
        if kind == SOLID:
            first = self.first[b]
            found = self.samples.covers(first + 1 + layer, p)
            found = found and abs(self.samples.linear(first, p).x) < h
        return found

    @ti.func
    def body_share(self, b, x, layer, h, pose):
        """Returns lambda (-) of one body, and its gradient [1/m]."""
        p = self.to_body_frame(b, x, pose)
        found = vec4(0.0)
        kind = self.kind[b]
        half = self.half[b]
        if kind == SOLID:
            found = self.mesh_share(b, p, layer, h)
        elif self.meets_kernel(b, p, layer, h):
            if kind == BLOCK:
                found = block_share(p, h, -half, half)
            else:
                part = ball_share(p.norm(), h, half[0])
                n = part[1] * p / ti.max(p.norm(), 1e-9)
                found = vec4(part[0], n[0], n[1], n[2])
        g = self.rotation[b, pose] @ found.yzw
        return vec4(found.x, g[0], g[1], g[2])

    @ti.func
    def mesh_share(self, b, p, layer, h):
        """Returns lambda of a mesh, or of the outside of a container, at p [m] in its frame."""
        found = vec4(0.0)
        first = self.first[b]
        m = first + 1 + layer
        if self.samples.covers(m, p):
            distance = self.samples.linear(first, p).x
            if abs(distance) < h:
                found = self.samples.spline(m, p)
            elif distance < 0.0:
                found.x = 1.0
        if self.side[b] < 0.0:
            found = vec4(1.0, 0.0, 0.0, 0.0) - found
        return found


@ti.func
def block_distance(p, half):
    """Returns the signed distance [m] to the box from -half to half, and its gradient."""
    q = abs(p) - half
    side = ti.select(p < 0.0, -1.0, 1.0)
    out = ti.max(q, 0.0)
    length = out.norm()
    distance, g = length, side * out / ti.max(length, 1e-9)
    if length == 0.0:
        distance = q.max()
        g = vec3(0.0)
        if q[0] == distance:
            g[0] = side[0]
        elif q[1] == distance:
            g[1] = side[1]
        else:
            g[2] = side[2]
    return vec4(distance, g[0], g[1], g[2])
