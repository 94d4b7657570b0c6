"""What a person can do to a show in one frame."""

from dataclasses import dataclass, field

from msph.fluid.external_forces import Hand

KEYS = (
    ("space", "pause and go on"),
    ("m", "slow motion, and back"),
    ("n", "single step while paused"),
    ("r", "reset"),
    ("v", "next view: water, layer, speed, density error, ..."),
    ("arrow keys", "tilt the pool"),
    ("left drag", "push the water"),
    ("right drag, a, d", "orbit"),
    ("w, s", "zoom in and out"),
    ("h", "hide or show the panel"),
    ("q, escape", "quit"),
)


@dataclass
class Controls:
    """The wishes of one frame.

    tilt: (roll about z, pitch about x) [rad] of the pool, beyond what the scene itself does.
    frame_time [s]: simulated time of the frame, None for the show's own. budget [s]: wall-clock
    time that the water may take, None for as long as it needs. scale (-): of the picture's edges,
    where the show is scalable.
    """

    tilt: tuple[float, float] = (0.0, 0.0)
    hand: Hand = field(default_factory=Hand)
    paused: bool = False
    single_step: bool = False
    reset: bool = False
    next_view: bool = False
    frame_time: float | None = None
    budget: float | None = None
    scale: float = 1.0
