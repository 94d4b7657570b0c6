"""User input for one frame: Inputs act on the simulation and are recorded, Controls are all."""

from dataclasses import dataclass, field, fields
from typing import Annotated

import numpy as np
from pydantic import ConfigDict, Field, NonNegativeFloat

from msph.fluid.external_forces import Hand, as_vector

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
    def of(cls, tool: str, vectors: tuple[np.ndarray, ...], step: float, held: float):
        """Returns the use of a tool, given by its name; vectors: place, velocity, start, surface
        and direction."""
        place, velocity, start, surface, direction = (as_vector(v) for v in vectors)
        return cls(tool, place, velocity, start, surface, direction, step, held)

    __pydantic_config__ = STRICT


@dataclass
class Inputs:
    """User input of one frame that acts on the simulation, as recorded; see Row.frame.

    frame_time [s]: simulated time of the frame, None for the show's default. until [s]: the frame
    ends with the first step that reaches this time, None for the frame time. still: no time passes.
    reset: begin again. set: live parameters that change, None for their initial values. tilt: (roll
    about z, pitch about x) [rad] of the pool seen from `azimuth` [rad], added to the scene's own
    sway. use: use of a tool.
    """

    frame_time: Annotated[float, Field(gt=0.0, le=MAX_FRAME_TIME)] | None = None
    until: NonNegativeFloat | None = None
    still: bool = False
    reset: bool = False
    set: dict[str, Number | None] = field(default_factory=dict)
    tilt: tuple[Number, Number] = (0.0, 0.0)
    azimuth: Number = 0.0
    use: ToolUse | None = None

    __pydantic_config__ = STRICT


@dataclass
class Controls(Inputs):
    """Input of one frame.

    hand: of a scripted user, where no tool is used. budget [s]: limit of the fluid's wall-clock
    time, None for no limit. hidden: no image is needed. scale (-): image scale, for scalable shows.
    """

    hand: Hand = field(default_factory=Hand)
    budget: float | None = None
    hidden: bool = False
    scale: float = 1.0

    def inputs(self) -> Inputs:
        """Returns the part that acts on the simulation."""
        return Inputs(**{f.name: getattr(self, f.name) for f in fields(Inputs)})
