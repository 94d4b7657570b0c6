"""Boundary of the water: the box, bodies in it, and optionally a container.

Each body has a share lambda of the kernel's integral around a particle: for a block the product
over its axes, for a ball the exact integral, for a mesh a map computed once per layer (Bender et
al. 2019, "Volume maps", here with exact integrals). The fluid's share is the product of (1 -
lambda) over all bodies, exact for bodies that are apart or pass through a wall. A body on a wall
should therefore extend into it; blocks that touch a wall are extended here.
"""

import math

import numpy as np
import taichi as ti

from msph.device_table import DeviceTable, f32, i32
from msph.fluid.boundary.mesh_samples import lattices, sample
from msph.fluid.boundary.rigid_bodies import (
    Ball,
    Block,
    Body,
    Solid,
    bounding_radius,
    centre,
    extended_into_walls,
)
from msph.fluid.boundary.sampled_fields import SampledFields, SampleLattice
from msph.fluid.boundary.wall_integrals import ball_share, block_share, swelling, wall_support
from msph.fluid.boundary.walls import Size, wall_constants
from msph.fluid.constants import Constants
from msph.fluid.particles.layers import Layers, LayerSpec
from msph.fluid.room import Room
from msph.taichi_internals import data_oriented, kernel

vec3, vec4 = ti.math.vec3, ti.math.vec4

BLOCK, BALL, SOLID = 0, 1, 2
# Largest number of bodies: 64 obstacles and a container.
MAX_BODIES = 65
# Index of a body's pose: at the beginning and at the end of a step.
BEGIN, END = 0, 1


@data_oriented
class Boundary:
    """The box and its bodies.

    Poses are stored for the beginning and the end of a step; velocities are means over the step.
    box [m], bodies and count are host values. Tables by body: kind; side, -1 if the water is
    inside, else 1; half, the half extents of a block or the radius of a ball [m]; bounding_radius
    [m]; first, index of a mesh's distance lattice, followed by its share lattices. Tables by body
    and pose: centre [m]; rotation, body frame to box frame; velocity [m/s] and spin [rad/s], equal
    for both poses.
    """

    def __init__(self, room: Room, constants: Constants, layers: Layers):
        self.constants, self.layers = constants, layers
        self.support, self.swell = layers.wall_support, layers.swell
        self._shapes = DeviceTable(
            (MAX_BODIES,), kind=i32, side=f32, half=vec3, bounding_radius=f32, first=i32
        )
        self._poses = DeviceTable(
            (MAX_BODIES, 2), centre=vec3, rotation=ti.math.mat3, velocity=vec3, spin=vec3
        )
        for table in (self._shapes, self._poses):
            self.__dict__.update({name: getattr(table, name) for name in table.fields})
        self.samples = SampledFields(room.samples)
        self.box, self.bodies, self.count = (0.0, 0.0, 0.0), [], 0
        self.moving, self.top_speed, self.time = False, 0.0, 0.0
        # Time [s] at which a body was stopped, by body.
        self.stopped: dict[int, float] = {}

    def load(
        self, size: Size, specs: list[LayerSpec], bodies: list[Body], open_top: bool = False
    ) -> None:
        """Fills the tables for a box of `size` [m], bodies and layers."""
        self.box = size
        walls = np.array(wall_constants(size, open_top)["walls"])
        self.bodies = [extended_into_walls(b, walls, specs) for b in bodies]
        self.count = len(self.bodies)
        self.moving = any(b.motion.moves for b in self.bodies)
        self.top_speed = max(
            (b.motion.top_speed(bounding_radius(b)) for b in self.bodies), default=0.0
        )
        if self.bodies:
            self._load_shapes(specs)
        self.velocities = self.spins = np.zeros((self.count, 3))
        self.reset(0.0)

    @property
    def container(self) -> int | None:
        """Index of the mesh that contains the water, None without one."""
        found = (k for k, b in enumerate(self.bodies) if isinstance(b, Solid) and b.container)
        return next(found, None)

    @staticmethod
    def layer_rows(specs: list[LayerSpec]) -> dict[str, np.ndarray]:
        """Returns the bodies' columns of the table by layer: wall_support and swell [m]."""
        return {
            "wall_support": np.array([wall_support(s) for s in specs]),
            "swell": np.array([swelling(s) for s in specs]),
        }

    def _load_shapes(self, specs: list[LayerSpec]) -> None:
        first: list[int] = []
        grids: list[SampleLattice] = []
        values: list[np.ndarray] = []
        for body in self.bodies:
            first.append(len(grids))
            if isinstance(body, Solid):
                own = lattices(body, specs)
                grids += own
                values += sample(body, own, specs)
        ends = [body.bounds for body in self.bodies]
        inward = [isinstance(b, Solid) and b.container for b in self.bodies]
        self._shapes.fill(
            kind=[(Block, Ball, Solid).index(type(b)) for b in self.bodies],
            side=np.where(inward, -1.0, 1.0),
            half=[0.5 * (hi - lo) for lo, hi in ends],
            bounding_radius=[bounding_radius(b) for b in self.bodies],
            first=first,
        )
        if grids:
            self.samples.load(grids, values)

    def reset(self, time: float) -> None:
        """Moves all bodies, including stopped ones, to their poses at `time` [s]."""
        self.stopped.clear()
        self.place(time, 0.0)

    def stop(self, body: int, time: float) -> None:
        """Keeps a body at its pose of `time` [s] until reset()."""
        self.stopped[body] = time

    def name(self, body: int) -> str:
        """Returns a body's name in scenes; obstacles are counted without the container."""
        solid = self.bodies[body]
        if isinstance(solid, Solid) and solid.container:
            return "container"
        before = sum(isinstance(b, Solid) and b.container for b in self.bodies[:body])
        return f"obstacles.{body - before}"

    def pose(self, body: int) -> tuple[np.ndarray, np.ndarray]:
        """Returns a body's displacement (3,) [m] and rotation (3, 3) at the end of the step."""
        last = min(self.time, self.stopped.get(body, math.inf))
        motion = self.bodies[body].motion
        return motion.offset(last), motion.rotation(last)

    def nearest_moving(self, x: np.ndarray) -> int:
        """Returns the index of the moving body nearest to x (3,) [m]."""
        moving = [k for k, body in enumerate(self.bodies) if body.motion.moves]
        return min(moving, key=lambda k: self._distance_from(k, *x.tolist()))

    @kernel
    def _distance_from(self, b: ti.i32, x: ti.f32, y: ti.f32, z: ti.f32) -> ti.f32:
        return self.distance(b, vec3(x, y, z), END).x

    def move(self, dt: float) -> None:
        """Advances the bodies by dt [s]."""
        if self.moving:
            self.place(self.time, dt)

    def place(self, time: float, dt: float) -> None:
        """Sets the bodies' poses at the beginning and end of a step of dt [s] from `time`."""
        self.time = time + dt
        if not self.bodies:
            return
        last = [self.stopped.get(k, math.inf) for k in range(self.count)]
        ends = [(min(time, t), min(time + dt, t)) for t in last]
        motions = [body.motion for body in self.bodies]
        shifts = np.array(
            [[m.offset(t) for t in pair] for m, pair in zip(motions, ends, strict=True)]
        )
        if dt > 0.0:
            self.velocities = (shifts[:, END] - shifts[:, BEGIN]) / dt
            spins = [m.spin() * (b > a) for m, (a, b) in zip(motions, ends, strict=True)]
            self.spins = np.array(spins)
        self._poses.fill(
            centre=np.array([centre(body) for body in self.bodies])[:, None] + shifts,
            rotation=[[m.rotation(t) for t in pair] for m, pair in zip(motions, ends, strict=True)],
            velocity=np.stack([self.velocities] * 2, axis=1),
            spin=np.stack([self.spins] * 2, axis=1),
        )

    def free(self, x: np.ndarray, margin: float = 0.0) -> np.ndarray:
        """Returns which points x (n, 3) are at least `margin` outside all bodies [m], (n,) bool."""
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
    def to_body_frame(self, b, x, pose):
        """Returns x [m] in the frame of body b."""
        return self.rotation[b, pose].transpose() @ (x - self.centre[b, pose])

    @ti.func
    def distance(self, b, x, pose):
        """Returns the distance [m] of x from body b, positive in the water, and its gradient."""
        return self.distance_by(b, x, pose, False)

    @ti.func
    def normal(self, b, x, pose):
        """Returns the unit normal of body b near x [m], towards the water; smooth for meshes."""
        return self.distance_by(b, x, pose, True).yzw.normalized(1e-9)

    @ti.func
    def distance_by(self, b, x, pose, smooth: ti.template()):
        """Like distance(); smooth: interpolate meshes by cubics."""
        p = self.to_body_frame(b, x, pose)
        found = vec4(0.0)
        kind = self.kind[b]
        if kind == BLOCK:
            found = block_distance(p, self.half[b])
        if kind == BALL:
            r = p.norm()
            n = p / ti.max(r, 1e-9)
            found = vec4(r - self.half[b][0], n[0], n[1], n[2])
        if kind == SOLID:
            if ti.static(smooth):
                found = self.samples.cubic(self.first[b], p)
            else:
                found = self.mesh_distance(b, p)
        g = self.rotation[b, pose] @ found.yzw
        return self.side[b] * vec4(found.x, g[0], g[1], g[2])

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
    def velocity_at(self, b, x):
        """Returns the velocity [m/s] of body b at x [m]."""
        return self.velocity[b, BEGIN] + self.spin[b, BEGIN].cross(x - self.centre[b, BEGIN])

    @ti.func
    def share(self, x, layer):
        """Returns the bodies' part (-) of the relative density of a layer's particle at x [m], its
        gradient [1/m], and minus its rate [1/s] by the bodies' motion.

        The part is 1 - product over bodies of (1 - lambda_b), without the box's walls.
        """
        free, slope, closing = 1.0, vec3(0.0), 0.0
        h = self.support[layer]
        for b in range(self.constants.bodies[None]):
            part = self.body_share(b, x, layer, h, BEGIN)
            g = part.yzw
            closing *= 1.0 - part.x
            closing += free * self.velocity_at(b, x).dot(g)
            slope = slope * (1.0 - part.x) - free * g
            free *= 1.0 - part.x
        return ti.Vector([1.0 - free, -slope[0], -slope[1], -slope[2], closing])

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
    def body_share(self, b, x, layer, h, pose):
        """Returns lambda (-) of one body enlarged by the layer's swell, and its gradient [1/m]."""
        p = self.to_body_frame(b, x, pose)
        found = vec4(0.0)
        kind = self.kind[b]
        half = self.half[b] + self.swell[layer]
        if kind == BLOCK and (abs(p) < half + h).all():
            found = block_share(p, h, -half, half)
        radius = self.half[b][0] + self.swell[layer]
        if kind == BALL and p.norm() < radius + h:
            part = ball_share(p.norm(), h, radius)
            n = part[1] * p / ti.max(p.norm(), 1e-9)
            found = vec4(part[0], n[0], n[1], n[2])
        if kind == SOLID:
            found = self.mesh_share(b, p, layer, h)
        g = self.rotation[b, pose] @ found.yzw
        return vec4(found.x, g[0], g[1], g[2])

    @ti.func
    def mesh_share(self, b, p, layer, h):
        """Returns lambda of a mesh at p [m] in its frame; of the outside for a container."""
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
