"""Parameters that may change while the water moves: those declared live that the scene models."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from msph.fluid.methods import METHODS
from msph.scene.parameters import parameters
from msph.scene.schema import Scene

# Terms that a scene without them has no kernels for.
TERMS = ("projection.viscosity", "projection.tension", "projection.shear_relief")


@dataclass(frozen=True)
class Live:
    """One of them: its dotted key, unit, help, and the range of its slider (-, or the unit). Of a
    vector the length is meant."""

    key: str
    unit: str
    text: str
    lo: float
    hi: float


def live_parameters(scene: Scene) -> list[Live]:
    """Those of a scene, in the order of its sections; ranges hold the scene's own value."""
    found = []
    for p in parameters(Scene):
        section = p.key.partition(".")[0]
        if p.live is None or (section in METHODS and section != scene.method):
            continue
        value = read(scene, p.key)
        # Without gravity there is no direction for it.
        if value > 0.0 or not (p.key in TERMS or p.key == "gravity"):
            lo, hi = min(p.live[0], value), max(p.live[1], value)
            found.append(Live(p.key, p.unit, p.text, lo, hi))
    return found


def read(scene: Scene, key: str) -> float:
    """The value of a live parameter, of a vector its length."""
    value: Any = scene
    for name in key.split("."):
        value = getattr(value, name)
    return float(np.linalg.norm(value))


def changed(scene: Scene, key: str, value: float) -> Scene:
    """The scene with another value of a live parameter."""
    section, _, name = key.rpartition(".")
    if not section:
        old = np.array(getattr(scene, name))
        vector = tuple((old * (value / np.linalg.norm(old))).tolist())
        return scene.model_copy(update={name: vector})
    part = getattr(scene, section).model_copy(update={name: value})
    return scene.model_copy(update={section: part})
