"""State of the floating bodies: poses and momenta, kept on the host in double precision.

Between impulses a body moves with constant velocity and angular momentum. Impulses of the water are
collected by body in the impulse ledger; contact between bodies is in collisions.py.
"""

import numpy as np

from msph.fluid.boundary.rigid_bodies import (
    Body,
    Motion,
    bounding_radius,
    centre,
    inertia,
    rotations,
)
from msph.fluid.external_forces import ExternalForces, cross, rotation_vector


class FloatingBodies:
    """Bodies with a mass: arrays with one row per floating body.

    which: indices among all bodies. held: True until the body is released. mass [kg]; inertia
    (3, 3) [kg m^2] about the centre of mass in the body's frame; reach: bounding radius [m]. x [m]
    is the centre of mass and turn (3, 3) the rotation at the end of a step, x_begin and turn_begin
    at its beginning; v [m/s]; spin_momentum [N m s], the angular momentum about the centre of mass,
    in the box's frame. received (6) [N s, N m s]: impulses of the water in the last step, of `step`
    [s]. applied (6) [N, N m]: forces and torques by the user. contact [N s]: impulse of walls and
    other bodies since the reset. inertia_work [J]: of the inertial forces of a moving box since the
    reset.
    """

    def __init__(self):
        self.load([])

    def load(self, bodies: list[Body]) -> None:
        """Takes the floating bodies among all bodies, at their poses at time zero."""
        self.which = np.array([k for k, b in enumerate(bodies) if b.mass is not None], int)
        floats = [bodies[k] for k in self.which]
        self.count = len(floats)
        self.mass = np.array([b.mass for b in floats], float)
        self.inertia = np.array([inertia(b) for b in floats]).reshape(-1, 3, 3)
        self._inverse = np.linalg.inv(self.inertia)
        self.reach = np.array([bounding_radius(b) for b in floats])
        self.release = np.array([b.release for b in floats])
        self._start = np.array([centre(b) for b in floats]).reshape(-1, 3)
        motions = [b.motion for b in floats if isinstance(b.motion, Motion)]
        self._velocity = np.array([m.velocity for m in motions], float).reshape(-1, 3)
        self._spin = np.array([m.spin() for m in motions]).reshape(-1, 3)
        self.reset()

    def reset(self) -> None:
        """Restores the state at time zero."""
        self.held = np.ones(self.count, bool)
        self.x, self.v = self._start.copy(), np.zeros((self.count, 3))
        self.turn = np.tile(np.eye(3), (self.count, 1, 1))
        self.spin_momentum = np.zeros((self.count, 3))
        self.let_go(0.0)
        self.received, self.contact = np.zeros((self.count, 6)), np.zeros((self.count, 3))
        self.applied = np.zeros((self.count, 6))
        self.inertia_work = 0.0
        self.step = 1.0
        self.advance(0.0)

    def let_go(self, time: float) -> tuple[np.ndarray, float] | None:
        """Releases the bodies that are held until `time` [s]; returns the momentum (3,) [kg m/s]
        and kinetic energy [J] of their motions at release, None if there are no such bodies."""
        due = self.held & (self.release <= time)
        if not due.any():
            return None
        momentum, kinetic = self.momentum(), self.kinetic()
        self.held = self.held & ~due
        self.v = np.where(due[:, None], self._velocity, self.v)
        spin = _times(self.inertia, self._spin)
        self.spin_momentum = np.where(due[:, None], spin, self.spin_momentum)
        return self.momentum() - momentum, self.kinetic() - kinetic

    def advance(self, dt: float) -> None:
        """Starts the next step, of dt [s], at the present end poses."""
        self.x_begin, self.turn_begin = self.x, self.turn
        self.redo(dt)

    def redo(self, dt: float) -> None:
        """Sets the end poses of the step of dt [s] by the present velocities. The rotation uses the
        angular velocity in the middle of the step."""
        self.x = self.x_begin + dt * self.v
        half = rotations(0.5 * dt * self._spin_at(self.turn_begin)) @ self.turn_begin
        self.turn = rotations(dt * self._spin_at(half)) @ self.turn_begin

    def poses(self) -> tuple[np.ndarray, ...]:
        """Returns the poses at the beginning and the end of the step, for take_poses()."""
        return self.x_begin, self.turn_begin, self.x, self.turn

    def take_poses(self, poses: tuple[np.ndarray, ...]) -> None:
        """Restores poses()."""
        self.x_begin, self.turn_begin, self.x, self.turn = poses

    def inverse_inertia(self, turn: np.ndarray) -> np.ndarray:
        """Returns the inverse inertias (n, 3, 3) in the box's frame for rotations `turn`."""
        free = 1.0 - self.held[:, None, None]
        return free * (turn @ self._inverse @ turn.transpose(0, 2, 1))

    def _spin_at(self, turn: np.ndarray) -> np.ndarray:
        return _times(self.inverse_inertia(turn), self.spin_momentum)

    @property
    def spin(self) -> np.ndarray:
        """Angular velocities [rad/s] at the beginning of the step, (n, 3)."""
        return self._spin_at(self.turn_begin)

    def push(self, impulse: np.ndarray, twist: np.ndarray) -> None:
        """Adds impulses [N s] and angular impulses [N m s] about the centres of mass, (n, 3)."""
        free = 1.0 - self.held[:, None]
        self.v = self.v + free * impulse / self.mass[:, None]
        self.spin_momentum = self.spin_momentum + free * twist

    def receive(self, pushes: np.ndarray) -> None:
        """Adds impulses and angular impulses of the water, (n, 6)."""
        self.received = self.received + pushes
        self.push(pushes[:, :3], pushes[:, 3:])

    def expected(self, dt: float) -> np.ndarray:
        """Returns the impulses (n, 6) that the water gives in the coming step of dt [s] if its
        forces are those of the last step; starts the sums of this step."""
        found = dt / self.step * self.received
        self.received, self.step = np.zeros((self.count, 6)), dt
        return found

    def change(self, motions: np.ndarray) -> None:
        """Adds changes of velocity [m/s] and spin [rad/s] by contact, (n, 6)."""
        impulse = self.mass[:, None] * motions[:, :3]
        world = self.turn_begin @ self.inertia @ self.turn_begin.transpose(0, 2, 1)
        self.contact = self.contact + impulse
        self.push(impulse, _times(world, motions[:, 3:]))

    def shift(self, shifts: np.ndarray) -> None:
        """Displaces the bodies by vectors [m] and rotation vectors [rad], (n, 6)."""
        turn = rotations(shifts[:, 3:])
        self.x, self.x_begin = self.x + shifts[:, :3], self.x_begin + shifts[:, :3]
        self.turn, self.turn_begin = turn @ self.turn, turn @ self.turn_begin

    def fall(self, dt: float, external: ExternalForces, box_centre: np.ndarray) -> None:
        """Adds gravity, the inertia of a moving box and the applied forces within dt [s] to the
        velocities."""
        if not self.count:
            return
        rate, torque = np.tile(external.gravity, (self.count, 1)), np.zeros((self.count, 3))
        if external.moving:
            field, turned = external.inertia_at(self.x - box_centre, self.v, dt)
            rate = rate + field + turned
            turn, spin = np.array(external.angular_velocity), self._spin_at(self.turn)
            world = self._inertia_in_box()
            own = world @ turn
            torque = -world @ np.array(external.angular_acceleration)
            torque -= cross(turn, own + self.spin_momentum)
            # The other part of the Coriolis torque, which does no work.
            torque += _times(world, cross(spin, turn)) - cross(spin, own)
        rate, torque = self.mass[:, None] * rate + self.applied[:, :3], torque + self.applied[:, 3:]
        self.push(dt * rate, dt * torque)

    def applied_since(self, poses: tuple[np.ndarray, ...], dt: float) -> tuple[np.ndarray, float]:
        """Returns the sum of the impulses (3,) [N s] and the work [J] of the applied forces in the
        last dt [s], which began at poses()."""
        turned = (
            rotation_vector(new @ old.T) for new, old in zip(self.turn, poses[3], strict=True)
        )
        moved = np.hstack([self.x - poses[2], np.reshape(list(turned), (-1, 3))])
        free = ~self.held[:, None] * self.applied
        return dt * free[:, :3].sum(axis=0), float((free * moved).sum())

    def add_inertia_work(
        self, dt: float, external: ExternalForces, sign: float, box_centre: np.ndarray
    ) -> None:
        """Adds half of the work [J] of inertial forces in a step of dt [s], at its beginning (sign
        -1) or end (sign 1), as InertiaWork does."""
        if not (self.count and external.moving):
            return
        r, turn = self.x - box_centre, np.array(external.angular_velocity)
        rise, world = np.array(external.angular_acceleration), self._inertia_in_box()
        psi = r @ np.array(external.inertia) + 0.5 * (cross(turn, r) ** 2).sum(axis=1)
        euler = (cross(rise, r) * self.v).sum(axis=1)
        twist = ((world @ rise) * self._spin_at(self.turn)).sum(axis=1)
        own = 0.5 * sign * (world @ turn) @ turn - 0.5 * dt * twist
        self.inertia_work += float((self.mass * (sign * psi - 0.5 * dt * euler) + own).sum())

    def _inertia_in_box(self) -> np.ndarray:
        """Returns the inertias (n, 3, 3) in the box's frame at the end of the step."""
        return self.turn @ self.inertia @ self.turn.transpose(0, 2, 1)

    def top_speed(self) -> float:
        """Returns the largest speed [m/s] of a point of a body."""
        if not self.count:
            return 0.0
        turning = np.linalg.norm(self.spin, axis=1) * self.reach
        return float((np.linalg.norm(self.v, axis=1) + turning).max())

    def momentum(self) -> np.ndarray:
        """Returns the sum of momenta [kg m/s], (3,)."""
        return self.mass @ self.v

    def angular_momentum(self) -> np.ndarray:
        """Returns the sum of angular momenta about the origin [kg m^2/s], (3,)."""
        orbital = cross(self.x, self.mass[:, None] * self.v)
        return (orbital + self.spin_momentum).sum(axis=0)

    def kinetic(self) -> float:
        """Returns the kinetic energy [J]."""
        spins = (self._spin_at(self.turn) * self.spin_momentum).sum()
        return float(0.5 * (self.mass @ (self.v**2).sum(axis=1) + spins))

    def state(self) -> np.ndarray:
        """Returns x, turn, v, spin_momentum, the force of the last step and held, (n, 25)."""
        turn, force = self.turn.reshape(-1, 9), self.received / self.step
        held = self.held[:, None].astype(float)
        return np.concatenate([self.x, turn, self.v, self.spin_momentum, force, held], axis=1)

    def restore(self, state: np.ndarray) -> None:
        """Restores a state()."""
        self.x, turn, self.v, self.spin_momentum, self.received, held = np.split(
            state.astype(float), (3, 12, 15, 18, 24), axis=1
        )
        self.held = held[:, 0] > 0.0
        self.step = 1.0
        self.turn = turn.reshape(-1, 3, 3)
        self.advance(0.0)


def _times(matrices: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Returns the products of (n, 3, 3) matrices and (n, 3) vectors."""
    return (matrices @ vectors[:, :, None])[:, :, 0]
