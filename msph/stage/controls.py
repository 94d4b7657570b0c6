"""What a person can do to a show in one frame, and the keys and gestures that ask for it."""

from dataclasses import dataclass, field

from msph.fluid.external_forces import Hand


@dataclass(frozen=True)
class Key:
    """keys: of the keyboard and mouse, as the window's library names them, each with the action it
    asks for; shown: these keys in words; does: what they do. hint: a few words that ask to try it,
    for what a stranger should try."""

    shown: str
    does: str
    keys: dict[str, str]
    hint: str = ""


# The one table that program, help overlay and README are made from.
KEYS = (
    Key("left drag", "push the water", {"LMB": "push"}, "drag: push the water"),
    Key(
        "arrow keys",
        "tilt the pool",
        dict.fromkeys(("Left", "Right", "Up", "Down"), "tilt"),
        "arrows: tilt",
    ),
    Key("l", "lock the tilt, or let the pool come level again", {"l": "lock"}),
    Key(
        "right drag, a, d",
        "orbit",
        {"RMB": "orbit", "a": "orbit", "d": "orbit"},
        "right drag: orbit",
    ),
    Key("w, s", "zoom in and out", {"w": "zoom", "s": "zoom"}),
    Key("middle drag", "move the view; also right drag with shift", {"MMB": "pan"}),
    Key("return", "home: the scene's view, the pool level", {"Return": "home"}),
    Key("space", "pause and go on", {" ": "pause"}, "space: pause"),
    Key("n", "single step while paused", {"n": "step"}),
    Key("m", "slow motion, and back", {"m": "slow_motion"}),
    Key("r", "reset", {"r": "reset"}),
    Key("v", "next view: water, speed, layers, pressure, ...", {"v": "next_view"}, "v: views"),
    Key("x", "slice: hide the near half of the particles", {"x": "slice"}),
    Key("left click", "a particle's neighbours, in a view of particles", {}),
    Key("i", "settings and scenes, graphs, or neither", {"i": "next_panel"}, "i: settings"),
    Key(
        "tab, backspace",
        "next and previous scene",
        {"Tab": "next_scene", "BackSpace": "previous_scene"},
    ),
    Key("p, c", "picture, and clip of the last 10 s, into out/", {"p": "picture", "c": "clip"}),
    Key("k, o", "keep this water, and open what was kept last", {"k": "keep", "o": "reopen"}),
    Key("h", "help", {"h": "help"}, "h: help"),
    Key("q, escape", "quit", {"q": "quit", "Escape": "quit"}),
)
ACTIONS = {name: action for key in KEYS for name, action in key.keys.items()}
# Keys and buttons of which it matters whether they are down.
HEARD = (*ACTIONS, "Shift")


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
