"""Live parameters: those that may change while a simulation runs."""

from dataclasses import dataclass

import numpy as np

from msph.fluid.methods import METHODS
from msph.scene.parameters import parameters
from msph.scene.parts import PARTS, value_of, with_value
from msph.scene.schema import Scene

# Parameters without a slider where they are 0: a part that is off has no kernels, and without
# gravity there is no direction for it.
HIDDEN_AT_ZERO = {"gravity", *(key for part in PARTS for key in part.off)}


@dataclass(frozen=True)
class Live:
    """One live parameter: its dotted key, unit, help, and the range of its slider [unit]. Of a
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
        if value > 0.0 or p.key not in HIDDEN_AT_ZERO:
            lo, hi = min(p.live[0], value), max(p.live[1], value)
            found.append(Live(p.key, p.unit, p.text, lo, hi))
    return found


def read(scene: Scene, key: str) -> float:
    """The value of a live parameter, of a vector its length."""
    return float(np.linalg.norm(value_of(scene, key)))


def changed(scene: Scene, key: str, value: float) -> Scene:
    """The scene with another value of a live parameter."""
    old = value_of(scene, key)
    if np.ndim(old):
        vector = np.array(old) * (value / np.linalg.norm(old))
        return with_value(scene, key, tuple(vector.tolist()))
    return with_value(scene, key, value)
