"""All that holds the water: the box, bodies in it, and a container in place of the box's walls.

Each body has a share of the kernel's integral round a particle: for a block the product over its
axes, for a ball the exact integral, for a mesh a map computed once per layer (Bender et al. 2019,
"Volume maps", here with exact integrals). The fluid's share is the product of (1 - share) over all
bodies, which is exact for bodies that stand apart or pass through a wall. So a body on a wall
should be sunk into it; blocks that touch a wall are sunk here.
"""

import math

import numpy as np
import taichi as ti

from msph.fluid.boundary.mesh_samples import lattices, sample
from msph.fluid.boundary.rigid_bodies import Ball, Block, Body, Solid, centre, reach, sunk
from msph.fluid.boundary.sampled_fields import SampledFields, SampleLattice
from msph.fluid.boundary.wall_integrals import ball_share, block_share, swelling, wall_support
from msph.fluid.particles.layers import LayerSpec
from msph.taichi_internals import data_oriented, kernel

vec3, vec4 = ti.math.vec3, ti.math.vec4

BLOCK, BALL, SOLID = 0, 1, 2
# Depth in a wall beyond which a particle counts as leaked, in spacings of the finest layer.
LEAK = 0.1
# Rounds of pushing a particle out of bodies and walls in turn: out of one may lead into the next.
# Without turns up to 8 of the 4,104 particles of the scene `pillar` leaked, with 8 rounds none.
ROUNDS = 8
# Index of a body's pose: at the begin and at the end of a step.
BEGIN, END = 0, 1


@data_oriented
class Boundary:
    """The box of `size` [m] and the bodies in it, for the particles of the given layers.

    Without bodies nothing is allocated. The pose of a body is kept for the begin and the end of a
    step; its velocity is the mean over the step.
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
        self.time = 0.0  # up to which bodies have moved [s]
        # Bodies that were stopped, and when [s].
        self.stopped: dict[int, float] = {}
        if self.bodies:
            self._allocate(specs)
            self.reset(0.0)

    def _allocate(self, specs: list[LayerSpec]) -> None:
        n = self.count
        self.support = ti.field(ti.f32, shape=len(specs))  # of the integrals' kernel [m]
        self.swell = ti.field(ti.f32, shape=len(specs))  # of bodies as a layer meets them [m]
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
            self.swell[k] = swelling(spec)
        grids: list[SampleLattice] = []
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
            self.samples = SampledFields(grids, values)

    def reset(self, time: float) -> None:
        """Puts the bodies where they stand at `time` [s], those too that were stopped."""
        self.stopped.clear()
        self.place(time, 0.0)

    def stop(self, body: int, time: float) -> None:
        """Lets a body stay where it was at `time` [s] until reset()."""
        self.stopped[body] = time

    def name(self, body: int) -> str:
        """What scenes call a body: obstacles are counted without the container."""
        solid = self.bodies[body]
        if isinstance(solid, Solid) and solid.container:
            return "container"
        before = sum(isinstance(b, Solid) and b.container for b in self.bodies[:body])
        return f"obstacles.{body - before}"

    def pose(self, body: int) -> tuple[np.ndarray, np.ndarray]:
        """Way of a body since time zero, (3,) [m], and its rotation, (3, 3), at the end of the
        step."""
        now = np.array(self.centre[body, END].to_list())
        return now - centre(self.bodies[body]), np.array(self.turn[body, END].to_list())

    def nearest_moving(self, x: np.ndarray) -> int:
        """Index of the moving body that is nearest to x [m], (3,)."""
        moving = [k for k, body in enumerate(self.bodies) if body.motion.moves]
        return min(moving, key=lambda k: self._distance_from(k, *x.tolist()))

    @kernel
    def _distance_from(self, b: ti.i32, x: ti.f32, y: ti.f32, z: ti.f32) -> ti.f32:
        return self.distance(b, vec3(x, y, z), END).x

    def move(self, dt: float) -> None:
        """Moves the bodies on by dt [s]."""
        if self.moving:
            self.place(self.time, dt)

    def place(self, time: float, dt: float) -> None:
        """Puts the bodies where a step from `time` of length dt [s] begins and where it ends."""
        self.time = time + dt
        for k, body in enumerate(self.bodies):
            motion = body.motion
            if dt > 0.0 and not motion.moves:
                continue
            last = self.stopped.get(k, math.inf)
            times = min(time, last), min(time + dt, last)
            ends = [motion.offset(t) for t in times]
            for pose, t in enumerate(times):
                self.centre[k, pose] = ti.Vector((centre(body) + ends[pose]).tolist())
                self.turn[k, pose] = ti.Matrix(motion.turn(t).tolist())
            if dt > 0.0:
                self.velocity[k] = ti.Vector(((ends[1] - ends[0]) / dt).tolist())
                turning = times[1] > times[0]
                self.spin[k] = ti.Vector((motion.spin() * turning).tolist())

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

        Outside the lattice it is a lower bound. With c the lattice's point nearest to p,
        |p - q|^2 >= |p - c|^2 + |c - q|^2 for all q of the mesh, since the lattice is convex.
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
        """The bodies' part (-) of the relative density of a layer's particle at x [m], and its
        gradient [1/m]; where bodies move, as fifth number minus its rate by their motion [1/s].

        The part is 1 - product over bodies of (1 - lambda_b), without the box's walls.
        """
        free, slope, closing = 1.0, vec3(0.0), 0.0
        h = self.support[layer]
        for b in range(self.count):
            part = self.body_share(b, x, layer, h, BEGIN)
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
    def open_share(self, x, layer, pose):
        """The part (-) of a layer's kernel round x [m] that lies outside of all bodies, the product
        of 1 - lambda_b, and its gradient [1/m]."""
        free, slope = 1.0, vec3(0.0)
        h = self.support[layer]
        for b in range(self.count):
            part = self.body_share(b, x, layer, h, pose)
            slope = slope * (1.0 - part.x) - free * part.yzw
            free *= 1.0 - part.x
        return vec4(free, slope[0], slope[1], slope[2])

    @ti.func
    def body_share(self, b, x, layer, h, pose):
        """lambda (-) of one body, swollen as `layer` meets it, and its gradient [1/m]; zero where
        the body is out of reach."""
        p = self.inside(b, x, pose)
        found = vec4(0.0)
        kind = self.kind[b]
        if ti.static(Block in self.kinds):
            half = self.half[b] + self.swell[layer]
            if kind == BLOCK and (abs(p) < half + h).all():
                found = block_share(p, h, -half, half)
        if ti.static(Ball in self.kinds):
            radius = self.half[b][0] + self.swell[layer]
            if kind == BALL and p.norm() < radius + h:
                part = ball_share(p.norm(), h, radius)
                n = part[1] * p / ti.max(p.norm(), 1e-9)
                found = vec4(part[0], n[0], n[1], n[2])
        if ti.static(Solid in self.kinds):
            if kind == SOLID:
                found = self.mesh_share(b, p, layer, h)
        g = self.turn[b, pose] @ found.yzw
        return vec4(found.x, g[0], g[1], g[2])

    @ti.func
    def mesh_share(self, b, p, layer, h):
        """lambda of a mesh at p [m] in its frame: of its inside, for a container of its outside."""
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
    def keep(self, x, pose, margin):
        """The nearest place to x [m] that is `margin` [m] away from all walls."""
        if ti.static(self.count > 0):
            for _ in range(ROUNDS):
                for b in range(self.count):
                    near = self.distance(b, x, pose)
                    if near.x < margin:
                        x -= (near.x - margin) * near.yzw / ti.max(near.yzw.norm_sqr(), 0.25)
                # In the wedge between a body and a wall both must push in turn.
                x = ti.math.clamp(x, margin, self.size - margin)
        return ti.math.clamp(x, margin, self.size - margin)

    @ti.func
    def guard(self, x, v, restitution, margin):
        """Position [m] and velocity [m/s] of a particle at the end of a step, stopped `margin` [m]
        before walls and bodies; the change of velocity [m/s] that is by bodies, and their work on
        it [J/kg]."""
        by_bodies, work = vec3(0.0), 0.0
        if ti.static(self.count > 0):
            for b in range(self.count):
                near = self.distance(b, x, END)
                if near.x < margin:
                    n = near.yzw.normalized(1e-9)
                    own = self.velocity_at(b, x)
                    push = -(1.0 + restitution) * ti.min((v - own).dot(n), 0.0) * n
                    v += push
                    by_bodies += push
                    work += push.dot(own)
        # Before keep() moves x off the walls: else what slides along a wall falls on for ever.
        for k in ti.static(range(3)):
            if x[k] < margin or x[k] > self.size[k] - margin:
                v[k] = -restitution * v[k]
        return self.keep(x, END, margin), v, by_bodies, work

    @ti.func
    def leaked(self, x):
        """Whether x [m] is outside the box, or deeper than LEAK spacings inside a body."""
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
