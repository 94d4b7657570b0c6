"""Tools: actions of the left mouse button on the water."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import numpy as np
from pydantic import ConfigDict, Field

from msph.fluid.external_forces import Hand, Vec3, as_vector
from msph.stage import floats, pistons, taps

if TYPE_CHECKING:
    from msph.stage.show import Show

# Least radius of a hand in finest spacings, below which it slips between the particles.
LEAST_RADIUS = 1.5
# Least duration of a press [s], also of a shorter click. During this time a push goes down at
# POKE_SPEED sqrt(g R) within POKE_RADIUS R, R the push radius: a click makes a ring wave.
PRESS_TIME, POKE_SPEED, POKE_RADIUS = 0.1, 0.8, 0.6
# Pull: radius and height of its centre above the water over the push radius; rate [1/s].
PULL_RADIUS, PULL_HEIGHT, PULL_RATE = 1.3, 0.5, 5.0
# Swirl: speed at the push radius R over sqrt(g R), which makes a funnel about R/2 deep in 1 s.
SWIRL_SPEED = 1.6
# Hover: radius and grip over those of a push; largest speed [m/s], since the cursor's ray jumps
# between wave crests.
WAKE_RADIUS, WAKE_GRIP, WAKE_SPEED = 0.3, 0.25, 2.0
# Rain: drops per second, time between two additions [s] (each takes milliseconds), radius of the
# shower over the push radius, height of the start above the water over the box's height, speed
# there [m/s].
RAIN_RATE, RAIN_EVERY, RAIN_RADIUS, RAIN_HEIGHT, RAIN_SPEED = 40.0, 0.1, 0.8, 0.35, 1.5
# Ball: radius over the box's longest edge, distance from the water towards the camera in radii,
# and speed over sqrt(g L) of the box's longest edge L.
BALL_RADIUS, BALL_DISTANCE, BALL_SPEED = 0.08, 3.0, 0.7

# Largest speed of a hand over sqrt(g L) of the box's longest edge L: faster cursors jump.
HAND_SPEED = 30.0
# Largest simulated time of a frame [s].
MAX_FRAME_TIME = 1.0

# Recorded input: no unknown keys, and finite numbers of limited size [m, m/s, rad, s].
STRICT = ConfigDict(extra="forbid", allow_inf_nan=False)
Number = Annotated[float, Field(ge=-1e6, le=1e6)]
Time = Annotated[float, Field(ge=0.0, le=1e6)]
Vector = tuple[Number, Number, Number]


@dataclass(frozen=True)
class ToolUse:
    """Use of a tool in a frame, as recorded.

    place [m], velocity [m/s]: of a hand, in the box frame, that moves in the plane facing the
    camera through `start` [m], where the button was pressed; surface [m]: the water under the
    cursor, or the place; direction of the cursor's ray; held [s]: simulated time since the press;
    step [s]: the part of `held` in this frame.
    """

    tool: str
    place: Vector
    velocity: Vector
    start: Vector
    surface: Vector
    direction: Vector
    step: Annotated[float, Field(ge=0.0, le=MAX_FRAME_TIME)]
    held: Time

    @classmethod
    def of(cls, tool: "Tool", vectors: tuple[np.ndarray, ...], step: float, held: float):
        """Returns the use of a tool; vectors: place, velocity, start, surface and direction."""
        place, velocity, start, surface, direction = (as_vector(v) for v in vectors)
        return cls(tool.name, place, velocity, start, surface, direction, step, held)

    __pydantic_config__ = STRICT


class Touch:
    """Use of a tool on the water of a show; attributes as in ToolUse, with arrays (3,)."""

    def __init__(self, show: "Show", use: ToolUse):
        self.show, self.step, self.held = show, use.step, use.held
        self.place, self.velocity = np.array(use.place), np.array(use.velocity)
        self.start, self.surface = np.array(use.start), np.array(use.surface)
        self.direction = np.array(use.direction)

    @property
    def began(self) -> bool:
        """True in the frame of the press."""
        return self.held == self.step

    @property
    def size(self) -> np.ndarray:
        """Edges of the box [m]."""
        return np.array(self.show.simulation.size)

    @property
    def radius(self) -> float:
        """Radius of a push [m]."""
        least = LEAST_RADIUS * self.show.simulation.layers.finest.spacing
        return max(self.show.scene.play.push_radius * float(self.size.max()), least)

    def aim(self, room: float, back: float, speed: float) -> tuple[np.ndarray, np.ndarray]:
        """Returns start (3,) [m] and velocity (3,) [m/s] of a throw towards the water. back [m]:
        distance of the start from the water, towards the camera; room [m]: least distance from the
        walls; speed: over sqrt(g L), L the longest edge of the box."""
        start = self.surface + back * (self.up - self.direction)
        start = np.clip(start, room, np.maximum(self.size - room, room))
        way = self.surface - start
        fast = speed * math.sqrt(self.gravity * float(self.size.max()))
        return start, fast * way / max(float(np.linalg.norm(way)), 1e-9)

    @property
    def up(self) -> np.ndarray:
        """Vertical unit vector in the box frame."""
        return self.show.pose.tilt.T @ np.array((0.0, 1.0, 0.0))

    @property
    def gravity(self) -> float:
        """Absolute value of gravity [m/s^2], positive in weightless scenes, too."""
        return self.show.tool_gravity

    def hand(self, place: np.ndarray, radii: Vec3, velocity: np.ndarray, **more) -> Hand:
        """Returns a hand with the scene's grip, and at most HAND_SPEED."""
        grip = self.show.scene.play.push_grip
        most = HAND_SPEED * math.sqrt(self.gravity * float(self.size.max()))
        velocity = velocity * min(1.0, most / max(float(np.linalg.norm(velocity)), 1e-9))
        return Hand(as_vector(place), as_vector(velocity), radii, grip, **more)


@dataclass(frozen=True)
class Tool:
    """A tool. key: keyboard key; effect: text of the help page; act: returns the hand of a frame in
    which the button is down, and may add water and bodies (FullError). ball: the hand is shown as a
    ball."""

    name: str
    key: str
    effect: str
    act: Callable[[Touch], Hand]
    ball: bool = False


def push(touch: Touch) -> Hand:
    """Moves the water with the cursor; a short press goes down."""
    velocity, radius = touch.show.scene.play.push_gain * touch.velocity, touch.radius
    if touch.held <= PRESS_TIME:
        poke = POKE_SPEED * math.sqrt(touch.gravity * radius)
        if poke > float(np.linalg.norm(velocity)):
            velocity, radius = -poke * touch.up, POKE_RADIUS * radius
    return touch.hand(touch.place, (radius,) * 3, velocity)


def pull(touch: Touch) -> Hand:
    """Draws the water up to a point above the cursor."""
    place = touch.surface + PULL_HEIGHT * touch.radius * touch.up
    radii = (PULL_RADIUS * touch.radius,) * 3
    return touch.hand(place, radii, np.zeros(3), draw=PULL_RATE)


def swirl(touch: Touch) -> Hand:
    """Turns a column of water round the vertical axis through the cursor."""
    r = touch.radius
    spin = SWIRL_SPEED * math.sqrt(touch.gravity / r) * touch.up
    return touch.hand(touch.surface, (r, math.inf, r), np.zeros(3), spin=as_vector(spin))


def hover(touch: Touch) -> Hand:
    """Leaves a wake under a cursor without a button."""
    play, d = touch.show.scene.play, touch.show.simulation.layers.finest.spacing
    velocity = touch.velocity * min(
        1.0, WAKE_SPEED / max(float(np.linalg.norm(touch.velocity)), 1e-9)
    )
    radius = max(WAKE_RADIUS * play.push_radius * float(touch.size.max()), LEAST_RADIUS * d)
    grip = WAKE_GRIP * play.push_grip
    return Hand(as_vector(touch.place), as_vector(velocity), (radius,) * 3, grip)


def rain(touch: Touch) -> Hand:
    """Adds falling drops around the cursor."""
    batches = math.floor(touch.held / RAIN_EVERY) - math.floor(
        (touch.held - touch.step) / RAIN_EVERY
    )
    if not batches:
        return Hand()
    rng = touch.show.rng
    number = rng.poisson(RAIN_RATE * RAIN_EVERY * batches)
    up, size = touch.up, touch.size
    across = rng.normal(size=(number, 3))
    across -= np.outer(across @ up, up)
    across *= RAIN_RADIUS * touch.radius / np.sqrt((across**2).sum(axis=1, keepdims=True) + 1e-9)
    across *= np.sqrt(rng.random((number, 1)))
    height = RAIN_HEIGHT * size[1] * rng.uniform(0.7, 1.0, (number, 1))
    x = touch.surface + across + height * up
    spacing = touch.show.simulation.layers.finest.spacing
    touch.show.add_water(
        np.clip(x, spacing, size - spacing), np.tile(-RAIN_SPEED * up, (number, 1))
    )
    return Hand()


def ball(touch: Touch) -> Hand:
    """Throws a ball of water along the cursor's ray, once per press."""
    if touch.began:
        d = touch.show.simulation.layers.finest.spacing
        radius = max(BALL_RADIUS * float(touch.size.max()), LEAST_RADIUS * d)
        centre, velocity = touch.aim(radius + 0.5 * d, BALL_DISTANCE * radius, BALL_SPEED)
        cells = np.arange(-math.ceil(radius / d), math.ceil(radius / d) + 1) * d
        sites = np.stack(np.meshgrid(cells, cells, cells), axis=-1).reshape(-1, 3)
        x = centre + sites[(sites**2).sum(axis=1) <= radius**2]
        touch.show.add_water(x, np.tile(velocity, (len(x), 1)))
    return Hand()


TOOLS = (
    Tool("push", "f", "tool: drag to push the water", push, ball=True),
    Tool("pull", "g", "tool: hold to pull the water up to the cursor", pull),
    Tool("swirl", "t", "tool: hold to turn the water round the cursor", swirl),
    Tool("rain", "u", "tool: hold to let it rain at the cursor", rain),
    Tool("ball", "b", "tool: click to throw a ball of water", ball),
    Tool("wave", "e", "tool: drag an end wall to and fro (the first time takes long)", pistons.use),
    Tool(
        "float", "y", "tool: click to throw in a body (the first takes long), drag it", floats.use
    ),
    Tool("tap", "z", "tool: hold to pour water above the cursor", taps.tap),
    Tool("drain", "0", "tool: hold to drain water below the cursor", taps.drain),
)
# Tool of a cursor without a pressed button.
HOVER = Tool("hover", "", "", hover)
BY_NAME = {tool.name: tool for tool in (*TOOLS, HOVER)}
