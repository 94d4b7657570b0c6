"""Keys and gestures of the window, their actions and their help."""

from dataclasses import dataclass

from msph.stage.tools import TOOLS


@dataclass(frozen=True)
class Key:
    """Help entry of one or more keys. label: keys in words; effect: help text; keys: names in the
    window library, each with its action; hint: short invitation to try them."""

    label: str
    effect: str
    keys: dict[str, str]
    hint: str = ""


# Source of the key bindings and of the help page.
KEYS = (
    Key(
        "left drag",
        "use the active tool, first: push the water",
        {"LMB": "push"},
        "drag: push the water",
    ),
    *(Key(tool.key, tool.effect, {tool.key: f"tool {tool.key}"}) for tool in TOOLS),
    Key(
        "arrow keys",
        "tilt the pool",
        dict.fromkeys(("Left", "Right", "Up", "Down"), "tilt"),
        "arrows: tilt",
    ),
    Key("j", "jolt the pool", {"j": "jolt"}),
    Key("l", "lock the tilt, or level the pool again", {"l": "lock"}),
    Key(
        "right drag, a, d",
        "orbit the camera",
        {"RMB": "orbit", "a": "orbit", "d": "orbit"},
        "right drag: orbit",
    ),
    Key("w, s", "zoom in and out", {"w": "zoom", "s": "zoom"}),
    Key("middle drag", "pan the camera; also shift and right drag", {"MMB": "pan"}),
    Key("return", "reset the camera and the tilt", {"Return": "home"}),
    Key("space", "pause and resume", {" ": "pause"}, "space: pause"),
    Key("n", "single step while paused", {"n": "single_step"}),
    Key("m", "slow motion on and off", {"m": "slow_motion"}),
    Key("r", "reset the simulation", {"r": "reset"}),
    Key("v", "next view: water, speed, layers, pressure, ...", {"v": "next_view"}, "v: views"),
    Key("x", "slice: hide or show the near half of the particles", {"x": "slice"}),
    Key("left click", "select a particle and show its neighbours (in a particle view)", {}),
    Key("i", "panel: settings and scenes, graphs, or none", {"i": "next_panel"}, "i: settings"),
    Key(
        "tab, backspace",
        "next and previous scene",
        {"Tab": "next_scene", "BackSpace": "previous_scene"},
    ),
    Key("p, c", "save an image, a clip of the last 10 s, in out/", {"p": "picture", "c": "clip"}),
    Key("k, o", "save a checkpoint, open the newest one", {"k": "keep", "o": "reopen"}),
    Key("h", "help", {"h": "help"}, "h: help"),
    Key("q, escape", "quit", {"q": "quit", "Escape": "quit"}),
)
ACTIONS = {name: action for key in KEYS for name, action in key.keys.items()}
