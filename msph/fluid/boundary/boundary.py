"""Boundary of the water: the box, bodies in it, and optionally a container.

A wall does not mirror a body that passes through it; fixed blocks that touch a wall are extended
into it here.
"""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import taichi as ti

from msph.fluid.boundary.body_shapes import BEGIN, END, BodyShapes
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
from msph.fluid.boundary.sampled_fields import SampleLattice
from msph.fluid.boundary.wall_integrals import wall_support
from msph.fluid.boundary.walls import Size, wall_constants
from msph.fluid.constants import Constants
from msph.fluid.external_forces import ExternalForces, rotation_vector
from msph.fluid.particles.layers import Layers, LayerSpec
from msph.fluid.room import Room
from msph.kept_arrays import kept
from msph.launches import data_oriented, kernel

vec3, vec4 = ti.math.vec3, ti.math.vec4

# Corners of a box of half edges 1 about the origin, (8, 3).
CORNERS = 2.0 * np.indices((2, 2, 2)).reshape(3, 8).T - 1.0
# Depth [finest spacings] in a wall beyond which the wall does not mirror a body.
CROSSING = 0.25


@data_oriented
class Boundary(BodyShapes):
    """The box and its bodies.

    Poses are stored for the beginning and the end of a step; velocities are means over the step,
    for floating bodies present velocities. box [m], bodies and count are host values.
    """

    def __init__(self, room: Room, constants: Constants, layers: Layers):
        super().__init__(room, constants, layers)
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
        self._driven = [k for k, b in enumerate(self.bodies) if b.mass is None and b.motion.moves]
        self.driven = bool(self._driven)
        self._radii = {k: bounding_radius(self.bodies[k]) for k in self._driven}
        self.moving = self.driven or self.floating.count > 0
        # Centres at time zero, by pose.
        self._start = np.array([[centre(b)] * 2 for b in self.bodies])
        # Points (bodies, 3, n) [m] in the bodies' frames, and radius (bodies, 1) [m] around them,
        # beyond which no body reaches.
        outlines = [_outline(b) for b in self.bodies]
        most = max(map(len, outlines), default=0)
        padded = [np.resize(outline, (most, 3)) for outline in outlines]
        self._outlines = np.reshape(padded, (self.count, most, 3)).transpose(0, 2, 1).copy()
        self._radius = np.array([[getattr(b, "radius", 0.0)] for b in self.bodies])
        # Depth [m] of the thinnest body: from its middle to the water.
        self.thinnest = math.inf
        self._load_shapes(specs)
        # Mean velocities [m/s] and spins [rad/s] of bodies in prescribed motion, 0 of others.
        self._driven_motions = np.zeros((self.count, 6))
        self.reset(0.0)

    def add(self, body: Body, time: float) -> None:
        """Adds a body at `time` [s]; the present bodies keep their states. A floating body starts
        at its pose and with its motion of time zero."""
        self._rearrange([*self.bodies, body], list(range(self.count)), time)

    def remove(self, body: int, time: float) -> None:
        """Removes a body at `time` [s]; the others keep their states."""
        self.removed_impulse = self.removed_impulse + self.impulse[body]
        kept = [k for k in range(self.count) if k != body]
        self._rearrange([self.bodies[k] for k in kept], kept, time)

    def _rearrange(self, bodies: list[Body], kept: list[int], time: float) -> None:
        """Loads `bodies`, of which the first are the present bodies `kept`, in their states at
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
        """Impulse [N s] of the water on all present and removed bodies since the reset, (3,)."""
        return self.impulse.sum(axis=0) + self.removed_impulse

    @property
    def container(self) -> int | None:
        """Index of the mesh that contains the water, None without a container."""
        found = (k for k, b in enumerate(self.bodies) if isinstance(b, Solid) and b.container)
        return next(found, None)

    @staticmethod
    def layer_rows(specs: list[LayerSpec]) -> dict[str, np.ndarray]:
        """Returns the bodies' column of the table by layer: wall_support [m]."""
        return {"wall_support": np.array([wall_support(s) for s in specs])}

    def _load_shapes(self, specs: list[LayerSpec]) -> None:
        first: list[int] = []
        grids: list[SampleLattice] = []
        values: list[np.ndarray] = []
        for body in self.bodies:
            first.append(len(grids))
            depth = float(min(half_extents(body)))
            if isinstance(body, Solid):
                own = lattices(body, specs)
                grids += own
                values += sample(body, own, specs)
                depth = math.inf if body.container else -float(values[-len(own)].min())
            self.thinnest = min(self.thinnest, depth)
        self._shape_rows: dict[str, Any] = dict(
            kind=[(Block, Ball, Solid).index(type(b)) for b in self.bodies],
            side=np.where(self._inward, -1.0, 1.0),
            half=np.reshape([half_extents(b) for b in self.bodies], (-1, 3)),
            bounding_radius=np.array([bounding_radius(b) for b in self.bodies]),
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
        """Returns True for a body in prescribed motion that moves or whose bounds meet the bounds
        of another such body: shares of joined bodies are combined by a product."""
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
        return -float((self._driven_motions * pushes).sum())

    def fall(self, dt: float, external: ExternalForces) -> tuple[np.ndarray, float] | None:
        """Changes the velocities of floating bodies by external forces within dt [s], and releases
        held ones; returns what FloatingBodies.let_go() does."""
        given = self.floating.let_go(self.time)
        if given:
            self._store_shapes()
        self.floating.fall(dt, external, 0.5 * np.array(self.box))
        return given

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
        centres, turns = self.poses_at_end()
        return centres[body] - centre(self.bodies[body]), turns[body]

    def centre_at_end(self, body: int) -> np.ndarray:
        """Returns a body's centre [m], (3,), at the end of the step."""
        return self.poses_at_end()[0][body]

    def corners_at_end(self) -> np.ndarray:
        """Returns the corners [m] of the bodies' bounding boxes, which turn with them, at the end
        of the step, (bodies, 8, 3)."""
        centres, turns = self.poses_at_end()
        corners = self._shape_rows["half"][:, None, :] * CORNERS
        return centres[:, None, :] + corners @ turns.transpose(0, 2, 1)

    def motions(self) -> np.ndarray:
        """Returns the velocities [m/s] and spins [rad/s] of all bodies, (bodies, 6)."""
        found, floating = self._driven_motions.copy(), self.floating
        found[floating.which] = np.hstack([floating.v, floating.spin])
        return found

    def close_together(self, gap: float) -> bool:
        """Returns True if a body may be within `gap` [m] of a wall or another body at the beginning
        of the step."""
        centres, reach = self._at_begin[0], self._shape_rows["bounding_radius"] + gap
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

    def poses_at_end(self) -> tuple[np.ndarray, np.ndarray]:
        """Returns the centres [m], (bodies, 3), and rotations, (bodies, 3, 3), of all bodies at the
        end of the step."""
        return self._at_end if self.bodies else (np.zeros((0, 3)), np.zeros((0, 3, 3)))

    def take_poses(self, centres: np.ndarray, turns: np.ndarray) -> None:
        """Sets poses_at_end(), for images; the bodies have no velocities."""
        floating = self.floating
        floating.x, floating.turn = centres[floating.which], turns[floating.which]
        self._at_end = centres, turns
        self._poses.fill(
            centre=np.stack([centres] * 2, axis=1), rotation=np.stack([turns] * 2, axis=1)
        )

    @contextmanager
    def shifted(self, dt: float) -> Iterator[None]:
        """Context in which the end poses are those of dt [s] later, for reading."""
        if dt == 0.0 or not self.moving:
            yield
            return
        kept, now = self.floating.poses(), self.time
        self.place(now, dt)
        try:
            yield
        finally:
            self.floating.take_poses(kept)
            self._place(now, 0.0)

    def _place(self, time: float, dt: float) -> None:
        self.time = time + dt
        if not self.bodies:
            return
        centres = self._start.copy()
        turns = np.zeros((self.count, 2, 3, 3)) + np.eye(3)
        for k in self._driven:
            motion, last = self.bodies[k].motion, self.stopped.get(k, math.inf)
            ends = min(time, last), min(time + dt, last)
            shifts = [motion.offset(t) for t in ends]
            centres[k] += shifts
            turns[k] = [motion.rotation(t) for t in ends]
            if dt > 0.0:
                turned = rotation_vector(turns[k, END] @ turns[k, BEGIN].T)
                self._driven_motions[k] = np.concatenate([shifts[END] - shifts[BEGIN], turned]) / dt
        inverse_inertia = np.zeros((self.count, 2, 3, 3))
        floating, k = self.floating, self.floating.which
        if floating.count:
            centres[k] = np.stack([floating.x_begin, floating.x], axis=1)
            turns[k] = np.stack([floating.turn_begin, floating.turn], axis=1)
            inverse_inertia[k, BEGIN] = floating.inverse_inertia(floating.turn_begin)
            inverse_inertia[k, END] = floating.inverse_inertia(floating.turn)
        self._at_begin, self._at_end = ((centres[:, p], turns[:, p]) for p in (BEGIN, END))
        motions = self.motions()[:, None].repeat(2, axis=1)
        self._poses.fill(
            centre=centres,
            rotation=turns,
            velocity=motions[..., :3],
            spin=motions[..., 3:],
            inverse_inertia=inverse_inertia,
        )

    def find_mirrors(self) -> None:
        """Finds the walls that mirror each body at the beginning of the step, as bits: those within
        a kernel's reach that it does not cross."""
        if not self.bodies:
            return
        centres, turns = self._at_begin
        points = turns @ self._outlines
        lo = centres + points.min(axis=2) - self._radius
        hi = centres + points.max(axis=2) + self._radius
        gaps = np.concatenate([lo, self._walls - hi], axis=1)
        near = (gaps < self._reach) & (gaps > -self._crossing) & ~self._inward[:, None]
        self._mirrors.fill(mirroring=near @ (1 << np.arange(6)))

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


def _own_name(body: Body) -> str:
    """Returns the name of a body that is not in the scene's list of bodies, otherwise ""."""
    if isinstance(body, Solid) and body.container:
        return "container"
    return body.name if isinstance(body, Block) else ""


def _outline(body: Body) -> np.ndarray:
    """Returns the centre of a ball, the corners of a block or the vertices of a mesh's convex hull,
    (n, 3) [m], in the frame of the body."""

    def hull() -> list[np.ndarray]:
        from scipy.spatial import ConvexHull  # 0.2 s to import

        return [ConvexHull(body.vertices).vertices]

    if isinstance(body, Ball):
        return np.zeros((1, 3))
    if isinstance(body, Block):
        return CORNERS * half_extents(body)
    return body.vertices[kept(hull, "hull", body.vertices)[0]] - centre(body)
