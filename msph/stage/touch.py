"""Touch: a press of the left button on the water of a simulation, as the tools see it."""

import math
from typing import Any

import numpy as np

from msph.fluid.boundary.rigid_bodies import Body
from msph.fluid.external_forces import Hand, Vec3, as_vector
from msph.fluid.moving_box import MovingBox
from msph.fluid.simulation import Simulation
from msph.scene.observation import Play
from msph.stage.controls import ToolUse

# Least radius of a hand in finest spacings, below which it slips between the particles.
LEAST_RADIUS = 1.5
# Largest speed of a hand over sqrt(g L) of the box's longest edge L: faster cursors jump.
HAND_SPEED = 30.0
# Gravity for the speeds of tools in weightless scenes [m/s^2].
LEAST_GRAVITY = 1.0


class Touch:
    """Use of one tool on a simulation, from the press of the button to its release. kept: what the
    tool keeps from frame to frame.

    update() sets the attributes of a frame: play, the parameters of hands; box, with gravity; the
    attributes of ToolUse, with arrays (3,); began: True in the frame of the press; size: edges of
    the box [m]; spacing [m] of the finest particles; breadth [m]: scale of what tools move or add;
    radius [m] of a push; up: vertical unit vector in the box frame; gravity: its absolute value
    [m/s^2], positive in weightless scenes, too; fall [m/s]: sqrt(g L), L the longest edge of the
    box; wall: place [m] that the tool asks of the piston, None without a drag.
    """

    def __init__(self, simulation: Simulation, rng: np.random.Generator):
        self.simulation, self.rng = simulation, rng
        self.kept: Any = None

    def update(self, use: ToolUse, play: Play, box: MovingBox) -> None:
        self.play, self.box = play, box
        self.wall: float | None = None
        self.tool, self.step, self.held = use.tool, use.step, use.held
        self.place, self.velocity = np.array(use.place), np.array(use.velocity)
        self.start, self.surface = np.array(use.start), np.array(use.surface)
        self.direction, self.began = np.array(use.direction), use.held == use.step
        self.size, self.spacing = (
            np.array(self.simulation.size),
            self.simulation.layers.finest.spacing,
        )
        # A share of the longest edge would fill a deep pool or a channel.
        self.breadth = math.sqrt(self.size[0] * self.size[2])
        self.radius = max(play.push_radius * self.breadth, LEAST_RADIUS * self.spacing)
        self.up, self.gravity = box.up, least_gravity(box)
        self.fall = math.sqrt(self.gravity * float(self.size.max()))

    def aim(self, room: float, back: float, speed: float) -> tuple[np.ndarray, np.ndarray]:
        """Returns start (3,) [m] and velocity (3,) [m/s] of a throw towards the water. back [m]:
        distance of the start from the water, towards the camera; room [m]: least distance from the
        walls; speed: over `fall`."""
        start = self.surface + back * (self.up - self.direction)
        start = np.clip(start, room, np.maximum(self.size - room, room))
        way = self.surface - start
        return start, speed * self.fall * way / max(float(np.linalg.norm(way)), 1e-9)

    def hand(self, place: np.ndarray, radii: Vec3, velocity: np.ndarray, **more) -> Hand:
        """Returns a hand with the scene's grip, and at most HAND_SPEED."""
        velocity = limited(velocity, HAND_SPEED * self.fall)
        return Hand(as_vector(place), as_vector(velocity), radii, self.play.push_grip, **more)

    def add_water(self, x: np.ndarray, v: np.ndarray) -> None:
        """Adds particles of the finest layer at x [m] with velocities v [m/s], (n, 3), where there
        is room. Raises FullError."""
        layer = self.simulation.layers.finest_index
        self.simulation.add(x.astype(np.float32), v.astype(np.float32), layer, self.box.gravity)

    def add_body(self, body: Body) -> None:
        """Adds a floating body until the next reset. Raises FullError."""
        self.simulation.add_body(body, self.box.gravity)


def limited(velocity: np.ndarray, most: float) -> np.ndarray:
    """Returns a velocity (3,) of at most `most`, both in [m/s]."""
    return velocity * min(1.0, most / max(float(np.linalg.norm(velocity)), 1e-9))


def least_gravity(box: MovingBox) -> float:
    """Returns the absolute value of gravity [m/s^2] for the speeds of tools."""
    return max(math.hypot(*box.world_gravity), LEAST_GRAVITY)
