"""What is wrong with the probes of a scene."""

import numpy as np

from msph.fluid.boundary.rigid_bodies import Ball, Block
from msph.scene.errors import SceneError, in_metres
from msph.scene.obstacles import bodies
from msph.scene.schema import Probe, Scene
from msph.scene.water import TOLERANCE

# The keys that say where a probe of each kind is, one tuple of them or another.
KEYS: dict[str, tuple[tuple[str, ...], ...]] = {
    "pressure": (("point",), ("lo", "hi")),
    "velocity": (("point",),),
    "height": (("at",),),
    "front": (("axis",),),
    "flux": (("lo", "hi"),),
    "force": (("body",),),
}


def _check_probe(scene: Scene, probe: Probe, where: str, key: str) -> None:
    choices = KEYS[probe.kind]
    every = dict.fromkeys(k for sets in KEYS.values() for keys in sets for k in keys)
    given = tuple(name for name in every if getattr(probe, name) is not None)
    needed = " or ".join(" and ".join(names) for names in choices)
    for name in given:
        if not any(name in names for names in choices):
            problem = f"belongs to another kind of probe than {probe.kind}, which has {needed}"
            raise SceneError(where, problem, f"{key}.{name}")
    if given not in choices:
        raise SceneError(where, f"a probe of {probe.kind} needs {needed}", key)
    if probe.window and probe.kind != "pressure":
        raise SceneError(where, "only probes of pressure have one", f"{key}.window")
    size = np.array(scene.box.size)
    rooms = {"point": size, "lo": size, "hi": size, "at": size[[0, 2]]}
    for name in given:
        place, room = getattr(probe, name), rooms.get(name)
        if room is not None and (
            np.any(np.array(place) < -TOLERANCE) or np.any(np.array(place) > room + TOLERANCE)
        ):
            problem = f"{in_metres(place)} lies outside the box of {in_metres(size)}"
            raise SceneError(where, problem, f"{key}.{name}")
    if probe.lo is not None and probe.hi is not None:
        edges = np.array(probe.hi) - np.array(probe.lo)
        if sorted(np.sign(edges)) != [0.0, 1.0, 1.0]:
            problem = "must equal lo on one axis and exceed it on the others: a rectangle"
            raise SceneError(where, problem, f"{key}.hi")
    if probe.body is not None:
        bodies = {f"obstacles.{i}" for i in range(len(scene.obstacles))}
        bodies |= {"container"} if scene.container else set()
        if probe.body not in bodies:
            known = ", ".join(sorted(bodies)) or "none"
            raise SceneError(
                where, f"{probe.body} is no body of the scene; known: {known}", f"{key}.body"
            )


def check_probes(scene: Scene, where: str) -> None:
    """Raises SceneError for probes that cannot be built."""
    for i, probe in enumerate(scene.probes):
        _check_probe(scene, probe, where, f"probes.{i}")
        if probe.name in [p.name for p in scene.probes[:i]]:
            raise SceneError(
                where, f"there are two probes named {probe.name!r}", f"probes.{i}.name"
            )


def probe_cautions(scene: Scene) -> list[str]:
    """Probes at points that a block or a ball covers at the start, a line each."""
    if not any(p.point for p in scene.probes):
        return []
    return [
        f"probes.{i}: {in_metres(p.point)} is inside of a body, where there is nothing to read"
        for i, p in enumerate(scene.probes)
        if p.point and any(_covers(body, np.array(p.point)) for body in bodies(scene))
    ]


def _covers(body, point: np.ndarray) -> bool:
    """Whether a point is inside of a body; of meshes it is not known."""
    if isinstance(body, Ball):
        return bool(np.linalg.norm(point - body.centre) < body.radius - TOLERANCE)
    inside = isinstance(body, Block) and np.all((point > body.lo) & (point < body.hi))
    return bool(inside)
