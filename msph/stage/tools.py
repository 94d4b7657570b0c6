"""Tools: actions of the left mouse button on the water."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from msph.fluid.external_forces import Hand, Vec3, as_vector
from msph.fluid.moving_box import MovingBox
from msph.fluid.simulation import FullError, Simulation
from msph.scene.observation import Play
from msph.stage import floats, pistons, taps
from msph.stage.controls import ToolUse
from msph.stage.touch import LEAST_RADIUS, Touch, least_gravity, limited

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
# Ball: radius over the box's breadth, distance from the water towards the camera in radii,
# and speed over sqrt(g L) of the box's longest edge L.
BALL_RADIUS, BALL_DISTANCE, BALL_SPEED = 0.08, 3.0, 0.7


@dataclass(frozen=True)
class Tool:
    """A tool. key: keyboard key; effect: text of the help page; act: returns the hand of a frame in
    which the button is down, and may add water and bodies (FullError). ball: the hand is shown as a
    ball; bodies: the tool adds bodies."""

    name: str
    key: str
    effect: str
    act: Callable[[Touch], Hand]
    ball: bool = False
    bodies: bool = False


def push(touch: Touch) -> Hand:
    """Moves the water with the cursor; a short press goes down."""
    velocity, radius = touch.play.push_gain * touch.velocity, touch.radius
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
    play = touch.play
    velocity = limited(touch.velocity, WAKE_SPEED)
    radius = max(WAKE_RADIUS * play.push_radius * touch.breadth, LEAST_RADIUS * touch.spacing)
    grip = WAKE_GRIP * play.push_grip
    return Hand(as_vector(touch.place), as_vector(velocity), (radius,) * 3, grip)


def rain(touch: Touch) -> Hand:
    """Adds falling drops around the cursor."""
    batches = math.floor(touch.held / RAIN_EVERY) - math.floor(
        (touch.held - touch.step) / RAIN_EVERY
    )
    if not batches:
        return Hand()
    rng = touch.rng
    number = rng.poisson(RAIN_RATE * RAIN_EVERY * batches)
    up, size = touch.up, touch.size
    across = rng.normal(size=(number, 3))
    across -= np.outer(across @ up, up)
    across *= RAIN_RADIUS * touch.radius / np.sqrt((across**2).sum(axis=1, keepdims=True) + 1e-9)
    across *= np.sqrt(rng.random((number, 1)))
    height = RAIN_HEIGHT * size[1] * rng.uniform(0.7, 1.0, (number, 1))
    x = touch.surface + across + height * up
    x = np.clip(x, touch.spacing, size - touch.spacing)
    touch.add_water(x, np.tile(-RAIN_SPEED * up, (number, 1)))
    return Hand()


def ball(touch: Touch) -> Hand:
    """Throws a ball of water along the cursor's ray, once per press."""
    if touch.began:
        d = touch.spacing
        radius = max(BALL_RADIUS * touch.breadth, LEAST_RADIUS * d)
        centre, velocity = touch.aim(radius + 0.5 * d, BALL_DISTANCE * radius, BALL_SPEED)
        cells = np.arange(-math.ceil(radius / d), math.ceil(radius / d) + 1) * d
        sites = np.stack(np.meshgrid(cells, cells, cells), axis=-1).reshape(-1, 3)
        x = centre + sites[(sites**2).sum(axis=1) <= radius**2]
        touch.add_water(x, np.tile(velocity, (len(x), 1)))
    return Hand()


TOOLS = (
    Tool("push", "f", "tool: drag to push the water", push, ball=True),
    Tool("pull", "g", "tool: hold to pull the water up to the cursor", pull),
    Tool("swirl", "t", "tool: hold to turn the water round the cursor", swirl),
    Tool("rain", "u", "tool: hold to let it rain at the cursor", rain),
    Tool("ball", "b", "tool: click to throw a ball of water", ball),
    Tool(
        "wave",
        "e",
        "tool: drag an end wall to and fro (the first time takes long)",
        pistons.use,
        bodies=True,
    ),
    Tool(
        "float",
        "y",
        "tool: click to throw in a body (the first takes long), drag it",
        floats.use,
        bodies=True,
    ),
    Tool("tap", "z", "tool: hold to pour water above the cursor", taps.tap),
    # Shares its key: GGUI reports letters but no digits, and all letters have an action.
    Tool("drain", "z", "tool after the tap: hold to drain water below the cursor", taps.drain),
)
# Tool of a cursor without a pressed button.
HOVER = Tool("hover", "", "", hover)
BY_NAME = {tool.name: tool for tool in (*TOOLS, HOVER)}


def next_tool(key: str, active: Tool) -> Tool:
    """Returns the tool of a key. Of several tools with this key, returns the one after the active
    tool, or the first one if another tool is active."""
    tools = [tool for tool in TOOLS if tool.key == key]
    after = tools.index(active) + 1 if active in tools else 0
    return tools[after % len(tools)]


class Toolbox:
    """Tools on the water of a simulation; seed: of random drops.

    touch: the present press, None without one. After each frame, ball: centre [m] and radius [m] of
    the hand that images show, None without one; note: why a tool did nothing.
    """

    def __init__(self, simulation: Simulation, seed: int):
        self.simulation, self.rng = simulation, np.random.default_rng(seed)
        self.reset()

    def reset(self) -> None:
        self.touch: Touch | None = None
        self.ball: tuple[Vec3, float] | None = None
        self.note = ""

    def frame(self, use: ToolUse | None, play: Play, box: MovingBox, step: float) -> Hand:
        """Uses a tool in a frame of `step` [s], if any, removes a tap or drain that has closed,
        moves the wall that the user drags, and returns the tool's hand."""
        hand, asked = Hand(), None
        self.ball, self.note = None, ""
        if use is None:
            self.touch = None
        else:
            # Another press.
            if self.touch is None or use.tool != self.touch.tool or use.held == use.step:
                self.touch = Touch(self.simulation, self.rng)
            self.touch.update(use, play, box)
            tool = BY_NAME[use.tool]
            self.ball = (use.place, self.touch.radius) if tool.ball else None
            try:
                hand = tool.act(self.touch)
            except FullError as error:
                self.note = str(error)
            asked = self.touch.wall
        taps.close(self.simulation, closed_only=True)
        pistons.follow(self.simulation, least_gravity(box), step, asked)
        return hand
