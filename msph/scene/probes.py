"""Checks of a scene's probes."""

import numpy as np

from msph.fluid.boundary.rigid_bodies import Ball, Block
from msph.scene.bodies import bodies, number_of
from msph.scene.errors import TOLERANCE, explaining, in_metres, require
from msph.scene.observation import Probe
from msph.scene.schema import Scene

# Alternative sets of keys that place a probe of each kind.
PLACE_KEYS: dict[str, tuple[tuple[str, ...], ...]] = {
    "pressure": (("point",), ("lo", "hi")),
    "velocity": (("point",),),
    "height": (("at",),),
    "front": (("axis",),),
    "flux": (("lo", "hi"),),
    "force": (("body",),),
}


def check_probes(scene: Scene) -> None:
    """Raises SceneError if a probe cannot be built."""
    for i, probe in enumerate(scene.probes):
        _check_probe(scene, probe, f"probes.{i}")
        new = probe.name not in [p.name for p in scene.probes[:i]]
        require(new, f"probes.{i}.name", f"there are two probes named {probe.name!r}")


def _check_probe(scene: Scene, probe: Probe, key: str) -> None:
    choices = PLACE_KEYS[probe.kind]
    every = dict.fromkeys(k for sets in PLACE_KEYS.values() for keys in sets for k in keys)
    given = tuple(name for name in every if getattr(probe, name) is not None)
    needed = " or ".join(" and ".join(names) for names in choices)
    problem = f"is not a key of {probe.kind} probes, which need {needed}"
    for name in given:
        require(any(name in names for names in choices), f"{key}.{name}", problem)
    require(given in choices, key, f"a {probe.kind} probe needs {needed}")
    averaged = probe.kind == "pressure" or not probe.window
    require(averaged, f"{key}.window", "is a key of pressure probes only")
    size = np.array(scene.box.size)
    rooms = {"point": size, "lo": size, "hi": size, "at": size[[0, 2]]}
    for name in (each for each in given if each in rooms):
        place = np.array(getattr(probe, name))
        inside = np.all((place >= -TOLERANCE) & (place <= rooms[name] + TOLERANCE))
        problem = f"{in_metres(place)} is outside the box of {in_metres(size)}"
        require(inside, f"{key}.{name}", problem)
    if probe.lo is not None and probe.hi is not None:
        edges = np.sign(np.array(probe.hi) - np.array(probe.lo))
        problem = "must equal lo on one axis and exceed it on the others, to form a rectangle"
        require(sorted(edges) == [0.0, 1.0, 1.0], f"{key}.hi", problem)
    if probe.body is not None:
        with explaining(f"{key}.body"):
            number_of(scene, probe.body)


def probe_cautions(scene: Scene) -> list[str]:
    """Returns one line for each probe at a point inside a block or a ball at the start."""
    return [
        f"probes.{i}: {in_metres(p.point)} is inside a body, where the probe reads nothing"
        for i, p in enumerate(scene.probes)
        if p.point and any(_contains(body, np.array(p.point)) for body in bodies(scene))
    ]


def _contains(body, point: np.ndarray) -> bool:
    """Returns True if a block or a ball contains the point; False for meshes."""
    if isinstance(body, Ball):
        return bool(np.linalg.norm(point - body.centre) < body.radius - TOLERANCE)
    inside = isinstance(body, Block) and np.all((point > body.lo) & (point < body.hi))
    return bool(inside)
