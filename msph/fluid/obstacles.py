"""All that holds the water: the box, bodies in it, and a container in place of the box's walls.

Each body takes its share of the kernel's integral: a block by the product over its axes, a ball by
its exact integral, a mesh by a map computed once for every layer's h (Bender et al. 2019, "Volume
maps", with exact integrals). The fluid's share is the product over all of what each leaves, which
is exact for what stands apart or goes through a wall: a body that stands on a wall should be sunk
into it. Blocks that touch a wall are.
"""

import numpy as np
import taichi as ti

from msph.fluid.bodies import Ball, Block, Body, Solid, centre, reach, sunk
from msph.fluid.layers import LayerSpec
from msph.fluid.samples import Lattice, Samples
from msph.fluid.solids import lattices, sample
from msph.fluid.walls import ball_share, block_share, wall_support
from msph.launch import data_oriented, kernel

vec3, vec4 = ti.math.vec3, ti.math.vec4

BLOCK, BALL, SOLID = 0, 1, 2
# Depth in a wall beyond which a particle counts as leaked, in spacings of the finest layer.
LEAK = 0.1
# Rounds of leading a particle out: out of one body may be into another, or into a wall.
ROUNDS = 8
# Poses: where bodies stand when a step begins and when it ends.
BEGIN, END = 0, 1


@data_oriented
class Walls:
    """The walls of a fluid: box size [m], bodies, and the layers whose particles meet them.

    Without bodies it is the box alone, and nothing is allocated. A body's pose is kept twice, for
    the begin and the end of a step; velocities are the means over it.
    """

    def __init__(
        self,
        size: tuple[float, float, float],
        specs: list[LayerSpec],
        bodies: list[Body] | None = None,
    ):
        self.box, self.size = size, ti.Vector(list(size))
        self.bodies = [sunk(b, np.array(size), specs) for b in bodies or []]
        self.count = len(self.bodies)
        self.layers = len(specs)
        self.leak = LEAK * min(s.spacing for s in specs)
        self.moving = any(b.motion.moves for b in self.bodies)
        self.top_speed = max((b.motion.top_speed(reach(b)) for b in self.bodies), default=0.0)
        self.kinds = {type(b) for b in self.bodies}
        if self.bodies:
            self._allocate(specs)
            self.reset(0.0)

    def _allocate(self, specs: list[LayerSpec]) -> None:
        n = self.count
        self.support = ti.field(ti.f32, shape=len(specs))  # of the integrals' kernel [m]
        self.kind = ti.field(ti.i32, shape=n)
        self.side = ti.field(ti.f32, shape=n)  # 1, or -1 where the water is inside
        self.half = ti.Vector.field(3, ti.f32, shape=n)  # extents of a block, radius of a ball [m]
        self.reach = ti.field(ti.f32, shape=n)  # radius of a ball that holds the body [m]
        self.first = ti.field(ti.i32, shape=n)  # lattice of a mesh's distance; shares follow
        self.centre = ti.Vector.field(3, ti.f32, shape=(n, 2))
        self.turn = ti.Matrix.field(3, 3, ti.f32, shape=(n, 2))  # body frame to box frame
        self.velocity = ti.Vector.field(3, ti.f32, shape=n)
        self.spin = ti.Vector.field(3, ti.f32, shape=n)
        for k, spec in enumerate(specs):
            self.support[k] = wall_support(spec)
        grids: list[Lattice] = []
        values: list[np.ndarray] = []
        for k, body in enumerate(self.bodies):
            lo, hi = body.bounds
            self.side[k] = -1.0 if isinstance(body, Solid) and body.container else 1.0
            self.reach[k] = reach(body)
            self.half[k] = 0.5 * (hi - lo)
            self.kind[k] = (Block, Ball, Solid).index(type(body))
            if isinstance(body, Solid):
                self.first[k] = len(grids)
                own = lattices(body, specs)
                grids += own
                values += sample(body, own, specs)
        if grids:
            self.samples = Samples(grids, values)

    def reset(self, time: float) -> None:
        """Puts the bodies where they stand at `time` [s]."""
        self.place(time, 0.0)

    def place(self, time: float, dt: float) -> None:
        """Puts the bodies where a step from `time` of length dt [s] begins and where it ends."""
        for k, body in enumerate(self.bodies):
            motion = body.motion
            if dt > 0.0 and not motion.moves:
                continue
            ends = [motion.offset(t) for t in (time, time + dt)]
            for pose, t in enumerate((time, time + dt)):
                self.centre[k, pose] = ti.Vector((centre(body) + ends[pose]).tolist())
                self.turn[k, pose] = ti.Matrix(motion.turn(t).tolist())
            if dt > 0.0:
                self.velocity[k] = ti.Vector(((ends[1] - ends[0]) / dt).tolist())
                self.spin[k] = ti.Vector(motion.spin().tolist())

    def free(self, x: np.ndarray, margin: float = 0.0) -> np.ndarray:
        """Whether each point of x (n, 3) [m] is `margin` [m] outside of all bodies, (n,) bool."""
        found = np.ones(len(x), np.int32)
        if self.bodies:
            self._find_free(np.ascontiguousarray(x, np.float32), margin, found)
        return found > 0

    @kernel
    def _find_free(
        self,
        x: ti.types.ndarray(dtype=ti.f32, ndim=2),
        margin: ti.f32,
        found: ti.types.ndarray(dtype=ti.i32, ndim=1),
    ):
        for i in range(x.shape[0]):
            p = vec3(x[i, 0], x[i, 1], x[i, 2])
            found[i] = ti.cast(self.clearance(p, END) >= margin, ti.i32)

    @ti.func
    def inside(self, b, x, pose):
        """x [m] in the frame of body b."""
        return self.turn[b, pose].transpose() @ (x - self.centre[b, pose])

    @ti.func
    def distance(self, b, x, pose):
        """Distance [m] of x from body b, positive on the water's side, and its gradient."""
        return self.distance_by(b, x, pose, False)

    @ti.func
    def normal(self, b, x, pose):
        """Unit normal of body b near x [m], towards the water, smooth also for sampled meshes."""
        return self.distance_by(b, x, pose, True).yzw.normalized(1e-9)

    @ti.func
    def distance_by(self, b, x, pose, smooth: ti.template()):
        """As distance(); smooth: whether meshes are interpolated by cubics."""
        p = self.inside(b, x, pose)
        found = vec4(0.0)
        kind = self.kind[b]
        if ti.static(Block in self.kinds):
            if kind == BLOCK:
                found = block_distance(p, self.half[b])
        if ti.static(Ball in self.kinds):
            if kind == BALL:
                r = p.norm()
                n = p / ti.max(r, 1e-9)
                found = vec4(r - self.half[b][0], n[0], n[1], n[2])
        if ti.static(Solid in self.kinds):
            if kind == SOLID:
                if ti.static(smooth):
                    found = self.samples.cubic(self.first[b], p)
                else:
                    found = self.mesh_distance(b, p)
        g = self.turn[b, pose] @ found.yzw
        return self.side[b] * vec4(found.x, g[0], g[1], g[2])

    @ti.func
    def mesh_distance(self, b, p):
        """Distance of p, in its frame, from a mesh, and its gradient.

        Beyond the lattice a bound from below: with c the lattice's point nearest to p, by
        convexity |p - q|^2 >= |p - c|^2 + |c - q|^2 for all q of the mesh.
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
        """Distance [m] of x to the nearest body, negative inside of one."""
        found = 1e9
        for b in range(self.count):
            found = ti.min(found, self.distance(b, x, pose).x)
        return found

    @ti.func
    def velocity_at(self, b, x):
        """Velocity [m/s] of body b at x [m]."""
        return self.velocity[b] + self.spin[b].cross(x - self.centre[b, BEGIN])

    @ti.func
    def share(self, x, layer):
        """The bodies' part of the relative density of a layer's particle at x [m] (-), and its
        gradient [1/m]; where bodies move, fifth, -d/dt of that part by their motion alone [1/s].

        1 - product over bodies of (1 - lambda of each). The box's walls are not in it.
        """
        free, slope, closing = 1.0, vec3(0.0), 0.0
        h = self.support[layer]
        for b in range(self.count):
            part = self.body_share(b, x, layer, h)
            g = part.yzw
            closing *= 1.0 - part.x
            if ti.static(self.moving):
                closing += free * self.velocity_at(b, x).dot(g)
            slope = slope * (1.0 - part.x) - free * g
            free *= 1.0 - part.x
        if ti.static(self.moving):
            return ti.Vector([1.0 - free, -slope[0], -slope[1], -slope[2], closing])
        else:
            return vec4(1.0 - free, -slope[0], -slope[1], -slope[2])

    @ti.func
    def body_share(self, b, x, layer, h):
        """lambda of one body, and its gradient [1/m]; nothing where the body is out of reach."""
        p = self.inside(b, x, BEGIN)
        found = vec4(0.0)
        kind = self.kind[b]
        if ti.static(Block in self.kinds):
            if kind == BLOCK and (abs(p) < self.half[b] + h).all():
                found = block_share(p, h, -self.half[b], self.half[b])
        if ti.static(Ball in self.kinds):
            if kind == BALL and p.norm() < self.half[b][0] + h:
                part = ball_share(p.norm(), h, self.half[b][0])
                n = part[1] * p / ti.max(p.norm(), 1e-9)
                found = vec4(part[0], n[0], n[1], n[2])
        if ti.static(Solid in self.kinds):
            if kind == SOLID:
                found = self.mesh_share(b, p, layer, h)
        g = self.turn[b, BEGIN] @ found.yzw
        return vec4(found.x, g[0], g[1], g[2])

    @ti.func
    def mesh_share(self, b, p, layer, h):
        """lambda of a mesh at p in its frame: of its inside, or for a container its outside."""
        found = vec4(0.0)
        first = self.first[b]
        m = first + 1 + layer
        if self.samples.covers(m, p):
            distance = self.samples.linear(first, p).x
            if abs(distance) < h:
                found = self.samples.cubic(m, p)
            elif distance < 0.0:
                found.x = 1.0
        if self.side[b] < 0.0:
            found = vec4(1.0, 0.0, 0.0, 0.0) - found
        return found

    @ti.func
    def keep(self, x, pose, margin):
        """The nearest place to x [m] that is `margin` [m] away from all walls."""
        if ti.static(self.count > 0):
            for _ in range(ROUNDS):
                for b in range(self.count):
                    near = self.distance(b, x, pose)
                    if near.x < margin:
                        x -= (near.x - margin) * near.yzw / ti.max(near.yzw.norm_sqr(), 0.25)
                # Between a body and a wall only both in turn lead out.
                x = ti.math.clamp(x, margin, self.size - margin)
        return ti.math.clamp(x, margin, self.size - margin)

    @ti.func
    def guard(self, x, v, restitution, margin):
        """x [m] and v [m/s] of a particle at the end of a step, held back `margin` [m] before the
        walls it met."""
        if ti.static(self.count > 0):
            for b in range(self.count):
                near = self.distance(b, x, END)
                if near.x < margin:
                    n = near.yzw.normalized(1e-9)
                    against = (v - self.velocity_at(b, x)).dot(n)
                    v -= (1.0 + restitution) * ti.min(against, 0.0) * n
            x = self.keep(x, END, margin)
        for k in ti.static(range(3)):
            if x[k] < margin or x[k] > self.size[k] - margin:
                x[k] = ti.math.clamp(x[k], margin, self.size[k] - margin)
                v[k] = -restitution * v[k]
        return x, v

    @ti.func
    def leaked(self, x):
        """Whether x [m] is beyond the box, or deeper in a body than LEAK says."""
        out = (x < 0.0).any() or (x > self.size).any()
        if ti.static(self.count > 0):
            out = out or self.clearance(x, END) < -self.leak
        return out


@ti.func
def block_distance(p, half):
    """Signed distance [m] to the box from -half to half, negative inside, and its gradient."""
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
