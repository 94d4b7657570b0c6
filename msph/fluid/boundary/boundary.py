"""Boundary of the water: the box, bodies in it, and optionally a container.

Each body has a share lambda of the kernel's integral around a particle: for a block the product
over its axes, for a ball the exact integral, for a mesh a map computed once per layer (Bender et
al. 2019, "Volume maps", here with exact integrals). body_links.py adds the shares of all bodies
and of their mirror images. A wall does not mirror a body that passes through it; fixed blocks that
touch a wall are extended into it here.
"""

import math
from typing import Any

import numpy as np
import taichi as ti

from msph.device_table import DeviceTable, f32, i32
from msph.fluid.boundary.floating import FloatingBodies
from msph.fluid.boundary.mesh_samples import lattices, sample
from msph.fluid.boundary.pistons import Stroke
from msph.fluid.boundary.rigid_bodies import (
    Ball,
    Block,
    Body,
    Solid,
    bounding_radius,
    centre,
    extended_into_walls,
    half_extents,
)
from msph.fluid.boundary.sampled_fields import SampledFields, SampleLattice
from msph.fluid.boundary.wall_integrals import ball_share, block_share, swelling, wall_support
from msph.fluid.boundary.walls import Size, wall_constants
from msph.fluid.constants import Constants
from msph.fluid.external_forces import ExternalForces, rotation_vector
from msph.fluid.particles.layers import Layers, LayerSpec
from msph.fluid.room import MAX_BODIES, Room
from msph.taichi_internals import data_oriented, kernel

vec3, vec4 = ti.math.vec3, ti.math.vec4

BLOCK, BALL, SOLID = 0, 1, 2
# Depth [finest spacings] in a wall beyond which the wall does not mirror a body.
CROSSING = 0.25
# Index of a body's pose: at the beginning and at the end of a step.
BEGIN, END = 0, 1


@data_oriented
class Boundary:
    """The box and its bodies.

    Poses are stored for the beginning and the end of a step; velocities are means over the step,
    of floating bodies the present ones. box [m], bodies and count are host values. Tables by body:
    kind; side, -1 if the water is inside, else 1; half, the half extents of a block or the radius
    of a ball [m]; bounding_radius [m]; first, index of a mesh's distance lattice, followed by its
    share lattices; joined, 1 for bodies that may overlap others; inverse_mass [1/kg], 0 for
    prescribed motion; friction coefficient (-). Tables by body and pose: centre [m]; rotation, body
    frame to box frame; velocity [m/s] and spin [rad/s], equal for both poses; inverse_inertia
    [1/(kg m^2)] in the box frame; images, the walls that mirror the body as bits
    (MirrorImages.walls_near).
    """

    def __init__(self, room: Room, constants: Constants, layers: Layers):
        self.constants, self.layers = constants, layers
        self.support, self.swell = layers.wall_support, layers.swell
        self._shapes = DeviceTable(
            (MAX_BODIES,),
            **{"kind": i32, "side": f32, "half": vec3, "bounding_radius": f32, "first": i32},
            **{"joined": i32, "inverse_mass": f32, "friction": f32},
        )
        self._poses = DeviceTable(
            (MAX_BODIES, 2),
            **{"centre": vec3, "rotation": ti.math.mat3, "velocity": vec3, "spin": vec3},
            **{"inverse_inertia": ti.math.mat3, "images": i32},
        )
        for table in (self._shapes, self._poses):
            self.__dict__.update({name: getattr(table, name) for name in table.fields})
        self.samples = SampledFields(room.samples)
        self.box, self.bodies, self.count = (0.0, 0.0, 0.0), [], 0
        self.moving, self.driven, self.time = False, False, 0.0
        self.floating = FloatingBodies()
        # Time [s] at which a body was stopped, by body.
        self.stopped: dict[int, float] = {}

    def load(
        self, size: Size, specs: list[LayerSpec], bodies: list[Body], open_top: bool = False
    ) -> None:
        """Fills the tables for a box of `size` [m], bodies and layers."""
        self._specs, self._open_top = specs, open_top
        self.box, self._walls = size, np.array(wall_constants(size, open_top)["walls"])
        self.bodies = [extended_into_walls(b, self._walls, specs) for b in bodies]
        self.count = self.constants.bodies[None] = len(self.bodies)
        self.constants.covered[None] = sum(
            b.motion.wall for b in self.bodies if isinstance(b.motion, Stroke)
        )
        self.floating.load(self.bodies)
        self._reach = max(s.support for s in specs)
        self._crossing = CROSSING * min(s.spacing for s in specs)
        self._inward = np.array([isinstance(b, Solid) and b.container for b in self.bodies], bool)
        self._prescribed = [k for k, b in enumerate(self.bodies) if b.mass is None]
        self._driven = [k for k, b in enumerate(self.bodies) if b.mass is None and b.motion.moves]
        self.driven = bool(self._driven)
        self._radii = {k: bounding_radius(self.bodies[k]) for k in self._driven}
        self.moving = self.driven or self.floating.count > 0
        # Centres at time zero, by pose; and extents: half extents of blocks, radii of balls, and
        # corners of meshes that move.
        self._start = np.array([[centre(b)] * 2 for b in self.bodies])
        self._half = np.array(
            [[b.radius] * 3 if isinstance(b, Ball) else half_extents(b) for b in self.bodies]
        )
        self._round = np.array([isinstance(b, Ball) for b in self.bodies], bool)
        self._corners = {k: _corners(b) for k, b in enumerate(self.bodies) if isinstance(b, Solid)}
        if self.bodies:
            self._load_shapes(specs)
        self.velocities, self.spins = np.zeros((self.count, 3)), np.zeros((self.count, 3))
        self.reset(0.0)

    def add(self, body: Body, time: float) -> None:
        """Adds a body at `time` [s] to the present ones, which keep their states; a floating one at
        the pose and with the motion of its time zero."""
        self._rearrange([*self.bodies, body], list(range(self.count)), time)

    def remove(self, body: int, time: float) -> None:
        """Removes a body at `time` [s]; the others keep their states."""
        self.removed_impulse = self.removed_impulse + self.impulse[body]
        kept = [k for k in range(self.count) if k != body]
        self._rearrange([self.bodies[k] for k in kept], kept, time)

    def _rearrange(self, bodies: list[Body], kept: list[int], time: float) -> None:
        """Loads bodies of which the first ones are the present ones `kept`, in their states at
        `time` [s]."""
        stopped, removed = self.stopped.copy(), self.removed_impulse
        impulse, twist = self.impulse[kept], self.twist[kept]
        state = self.floating.state()[np.isin(self.floating.which, kept)]
        self.load(self.box, self._specs, bodies, self._open_top)
        self.stopped.update({n: stopped[k] for n, k in enumerate(kept) if k in stopped})
        self.impulse[: len(kept)], self.twist[: len(kept)] = impulse, twist
        self.removed_impulse = removed
        self.restore(time, np.concatenate([state, self.floating.state()[len(state) :]]))

    @property
    def top_speed(self) -> float:
        """Upper bound of the speed [m/s] of the bodies' points."""
        driven = (self.bodies[k].motion.top_speed(r) for k, r in self._radii.items())
        return max(*driven, self.floating.top_speed(), 0.0)

    @property
    def total_impulse(self) -> np.ndarray:
        """Impulse [N s] of the water on all bodies since the reset, removed ones included, (3,)."""
        return self.impulse.sum(axis=0) + self.removed_impulse

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
        self._shape_rows: dict[str, Any] = dict(
            kind=[(Block, Ball, Solid).index(type(b)) for b in self.bodies],
            side=np.where(self._inward, -1.0, 1.0),
            half=[half_extents(b) for b in self.bodies],
            bounding_radius=[bounding_radius(b) for b in self.bodies],
            first=first,
            joined=[self._is_joined(k) for k in range(self.count)],
            friction=[b.friction for b in self.bodies],
        )
        self._store_shapes()
        if grids:
            self.samples.load(grids, values)

    def _store_shapes(self) -> None:
        """Fills the table of shapes; held bodies are immovable."""
        inverse = np.zeros(self.count)
        inverse[self.floating.which] = (1.0 - self.floating.held) / self.floating.mass
        self._shapes.fill(**self._shape_rows, inverse_mass=inverse)

    def _is_joined(self, number: int) -> bool:
        """Returns True for a body in prescribed motion that moves, holds the water, or whose bounds
        meet those of another one: its share is combined with theirs by a product."""
        body = self.bodies[number]
        if body.mass is not None:
            return False
        lo, hi = body.bounds
        others = (b for k, b in enumerate(self.bodies) if k != number and b.mass is None)
        meets = any(np.all((b.bounds[0] <= hi) & (lo <= b.bounds[1])) for b in others)
        return meets or body.motion.moves

    def reset(self, time: float) -> None:
        """Moves all bodies, including stopped ones, to their poses at `time` [s]; floating bodies
        to those at time zero."""
        self.stopped.clear()
        self.floating.reset()
        if self.floating.count:
            self._store_shapes()
        # Impulses [N s] and angular impulses [N m s] of the water on the bodies since the reset.
        self.impulse, self.twist = np.zeros((self.count, 3)), np.zeros((self.count, 3))
        self.removed_impulse = np.zeros(3)
        self.place(time, 0.0)

    def restore(self, time: float, floating: np.ndarray) -> None:
        """Restores the FloatingBodies.state() of `time` [s]."""
        if self.floating.count:
            self.floating.restore(floating)
            self._store_shapes()
        self._place(time, 0.0)

    def push(self, pushes: np.ndarray) -> float:
        """Takes impulses and angular impulses by the water on all bodies, (bodies, 6), in the
        present step; returns the work [J] of bodies in prescribed motion on the water."""
        self.impulse, self.twist = self.impulse + pushes[:, :3], self.twist + pushes[:, 3:]
        self.floating.receive(pushes[self.floating.which])
        work = (self.velocities * pushes[:, :3] + self.spins * pushes[:, 3:]).sum(axis=1)
        return -float(work[self._prescribed].sum())

    def fall(self, dt: float, external: ExternalForces) -> None:
        """Changes the velocities of floating bodies by external forces within dt [s], and releases
        held ones."""
        if self.floating.let_go(self.time):
            self._store_shapes()
        self.floating.fall(dt, external, 0.5 * np.array(self.box))

    def add_inertia_work(self, dt: float, external: ExternalForces, sign: float) -> None:
        """Adds half of the work of inertial forces on floating bodies: see FloatingBodies."""
        self.floating.add_inertia_work(dt, external, sign, 0.5 * np.array(self.box))

    def stop(self, body: int, time: float) -> None:
        """Keeps a body at its pose of `time` [s] until reset()."""
        self.stopped[body] = time

    def name(self, body: int) -> str:
        """Returns a body's name in scenes; bodies are counted without container and wave makers."""
        names = [_own_name(b) for b in self.bodies[: body + 1]]
        return names[-1] or f"bodies.{names.count('') - 1}"

    def pose(self, body: int) -> tuple[np.ndarray, np.ndarray]:
        """Returns a body's displacement (3,) [m] and rotation (3, 3) at the end of the step."""
        if self.bodies[body].mass is not None:
            k = int(np.searchsorted(self.floating.which, body))
            return self.floating.x[k] - centre(self.bodies[body]), self.floating.turn[k]
        last = min(self.time, self.stopped.get(body, math.inf))
        motion = self.bodies[body].motion
        return motion.offset(last), motion.rotation(last)

    def centre_at_end(self, body: int) -> np.ndarray:
        """Returns a body's centre [m], (3,), at the end of the step."""
        return centre(self.bodies[body]) + self.pose(body)[0]

    def motions(self) -> tuple[np.ndarray, np.ndarray]:
        """Returns the velocities [m/s] and spins [rad/s] of all bodies, (bodies, 3) each."""
        velocities, spins = self.velocities.copy(), self.spins.copy()
        velocities[self.floating.which] = self.floating.v
        spins[self.floating.which] = self.floating.spin
        return velocities, spins

    def close_together(self, gap: float) -> bool:
        """Returns True if a body may be within `gap` [m] of a wall or another body."""
        centres = np.array([self.centre_at_end(b) for b in range(self.count)])
        reach = np.array([bounding_radius(b) for b in self.bodies]) + gap
        walls = np.minimum(centres, self._walls - centres).min(axis=1)
        apart = np.linalg.norm(centres[:, None] - centres, axis=2)
        np.fill_diagonal(apart, np.inf)
        return bool((walls < reach).any() or (apart < reach[:, None] + reach).any())

    def nearest_moving(self, x: np.ndarray) -> int:
        """Returns the index of the body in prescribed motion nearest to x (3,) [m]."""
        moving = [k for k, b in enumerate(self.bodies) if b.motion.moves and b.mass is None]
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
        self.floating.advance(dt)
        self._place(time, dt)

    def redo(self, dt: float) -> None:
        """Sets the end poses of the present step of dt [s] anew, after velocities changed."""
        if self.floating.count:
            self.floating.redo(dt)
            self._place(self.time - dt, dt)

    def _place(self, time: float, dt: float) -> None:
        self.time = time + dt
        if not self.bodies:
            return
        centres, turns = self._start.copy(), np.tile(np.eye(3), (self.count, 2, 1, 1))
        for k in self._driven:
            motion, last = self.bodies[k].motion, self.stopped.get(k, math.inf)
            ends = min(time, last), min(time + dt, last)
            shifts = [motion.offset(t) for t in ends]
            centres[k] += shifts
            turns[k] = [motion.rotation(t) for t in ends]
            if dt > 0.0:
                self.velocities[k] = (shifts[END] - shifts[BEGIN]) / dt
                self.spins[k] = rotation_vector(turns[k, END] @ turns[k, BEGIN].T) / dt
        inverse_inertia = np.zeros((self.count, 2, 3, 3))
        floating, k = self.floating, self.floating.which
        if floating.count:
            centres[k] = np.stack([floating.x_begin, floating.x], axis=1)
            turns[k] = np.stack([floating.turn_begin, floating.turn], axis=1)
            self.velocities[k], self.spins[k] = floating.v, floating.spin
            inverse_inertia[k, BEGIN] = floating.inverse_inertia(floating.turn_begin)
            inverse_inertia[k, END] = floating.inverse_inertia(floating.turn)
        self._poses.fill(
            centre=centres,
            rotation=turns,
            velocity=np.stack([self.velocities] * 2, axis=1),
            spin=np.stack([self.spins] * 2, axis=1),
            inverse_inertia=inverse_inertia,
            images=self._image_walls(centres, turns),
        )

    def _image_walls(self, centres: np.ndarray, turns: np.ndarray) -> np.ndarray:
        """Returns the walls, as bits, that mirror each body in each pose, (bodies, 2): those within
        a kernel's reach that it does not cross."""
        turned = np.where(self._round[:, None, None, None], np.eye(3), np.abs(turns))
        out = (turned @ self._half[:, None, :, None])[..., 0]
        lo, hi = centres - out, centres + out
        for b, corners in self._corners.items():
            points = corners @ turns[b].reshape(6, 3).T
            lo[b] = centres[b] + points.min(axis=0).reshape(2, 3)
            hi[b] = centres[b] + points.max(axis=0).reshape(2, 3)
        gaps = np.concatenate([lo, self._walls - hi], axis=2)
        near = (gaps < self._reach) & (gaps > -self._crossing) & ~self._inward[:, None, None]
        return near @ (1 << np.arange(6))

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
    def reaches(self, b, x, h, pose):
        """Returns False if body b is certainly farther than h [m] from x."""
        reach = self.bounding_radius[b] + h
        return self.side[b] < 0.0 or (x - self.centre[b, pose]).norm_sqr() < reach * reach

    @ti.func
    def free_of_others(self, b, x, layer, h):
        """Returns the product (-) of 1 - lambda over the joined bodies other than b."""
        free = 1.0
        for other in range(self.constants.bodies[None]):
            if other != b and self.joined[other] == 1:
                free *= 1.0 - self.body_share(other, x, layer, h, BEGIN).x
        return free

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
        """Returns False if lambda of body b, enlarged by the layer's swell, has no gradient at p
        [m], in the frame of b; h [m]: support of the kernel."""
        half, kind, found = self.half[b] + self.swell[layer], self.kind[b], False
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
        """Returns lambda (-) of one body enlarged by the layer's swell, and its gradient [1/m]."""
        p = self.to_body_frame(b, x, pose)
        found = vec4(0.0)
        kind = self.kind[b]
        half = self.half[b] + self.swell[layer]
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


def _own_name(body: Body) -> str:
    """Returns the name of a body that is none of the scene's list of bodies, else ""."""
    if isinstance(body, Solid) and body.container:
        return "container"
    return body.name if isinstance(body, Block) else ""


def _corners(mesh: Solid) -> np.ndarray:
    """Returns the vertices (n, 3) [m] of a mesh's convex hull, in its frame."""
    from scipy.spatial import ConvexHull  # only meshes need it

    return mesh.vertices[ConvexHull(mesh.vertices).vertices] - centre(mesh)


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
