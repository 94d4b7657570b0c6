"""Live parameters: parameters that may change while a simulation runs."""

from dataclasses import dataclass

import numpy as np

from msph.fluid.methods import METHODS
from msph.scene.parameters import parameters
from msph.scene.parts import PARTS, value_of, with_value
from msph.scene.schema import Scene

# Parameters that get no slider if they are 0: the kernels of a part that is off are not built, and
# zero gravity has no direction.
HIDDEN_AT_ZERO = {"gravity", *(key for part in PARTS for key in part.off)}


@dataclass(frozen=True)
class Live:
    """A live parameter: dotted key, unit, help text, label and range [unit] of its slider; for a
    vector, the range of its length."""

    key: str
    unit: str
    text: str
    label: str
    lo: float
    hi: float


def live_parameters(scene: Scene) -> list[Live]:
    """Returns the live parameters of a scene in the order of its sections; each range includes the
    scene's own value."""
    found = []
    for p in parameters(Scene):
        section = p.key.partition(".")[0]
        if p.live is None or (section in METHODS and section != scene.method):
            continue
        value = read(scene, p.key)
        if value > 0.0 or p.key not in HIDDEN_AT_ZERO:
            lo, hi = min(p.live[0], value), max(p.live[1], value)
            found.append(Live(p.key, p.unit, p.text, p.label, lo, hi))
    return found


def read(scene: Scene, key: str) -> float:
    """Returns the value of a live parameter; for a vector, its length."""
    return float(np.linalg.norm(value_of(scene, key)))


def with_live_value(scene: Scene, key: str, value: float) -> Scene:
    """Returns the scene with another value of a live parameter; a vector keeps its direction."""
    old = value_of(scene, key)
    if np.ndim(old):
        vector = np.array(old) * (value / np.linalg.norm(old))
        return with_value(scene, key, tuple(vector.tolist()))
    return with_value(scene, key, value)
