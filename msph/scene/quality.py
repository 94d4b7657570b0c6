"""The quality ladder: the same scene with larger or smaller particles, for the machine at hand."""

import json
import math
from dataclasses import dataclass

import numpy as np

from msph.scene.check import check
from msph.scene.errors import SceneError
from msph.scene.library import assets
from msph.scene.load import load_scene
from msph.scene.schema import Scene
from msph.scene.water import layer_specs, settled_count


@dataclass(frozen=True)
class Quality:
    """One step of the ladder.

    spacing (-): factor of all spacings. Where the scene gives none, motion_tolerance (-): share of
    the motion that the pressure solve may leave; cfl (-): spacings that it may go in a step.
    """

    spacing: float
    motion_tolerance: float = 0.01
    cfl: float = 0.5


# From coarse to fine, each with half the volume per particle of the one before; "large" is what
# scenes say. Looser tolerances and longer steps are undominated in still and sloshing water, not in
# dam breaks (bench/results/pareto.md): they are for the time, and their error is printed. Narrower
# supports cost more at equal error everywhere (bench/results/quality_settings.md).
LADDER = {
    "small": Quality(2.0 ** (2.0 / 3.0), 0.03, 0.8),
    "medium": Quality(2.0 ** (1.0 / 3.0), 0.03, 0.8),
    "large": Quality(1.0),
    "finest": Quality(2.0 ** (-1.0 / 3.0)),
}
# What a scene is if nobody asks for anything, and what asks for the machine's own choice.
AS_GIVEN, AUTO = "large", "auto"
NAMES = (AUTO, *LADDER)
# Share of the wall-clock time that the water's dearest half second may take in real time: the rest
# is for surface and picture.
WATER_SHARE = 0.6
# Pictures per second for which the display's processor time is set aside.
LEAST_RATE = 30.0
# sqrt(g H)/d of the dam break in its box H = .9 m high [1/s]: steps per second go with it.
DAM_BREAK_RATE = math.sqrt(9.81 * 0.9) / 0.0315
# Sections of a scene on which the cost of its water depends; camera, picture and keys do not.
WATER = (
    *("method", "density", "gravity", "box", "layers", "water", "obstacles", "container"),
    *("projection", "adaptation", "sway"),
)


def fixed(scene: Scene) -> str | None:
    """Why the scene has one quality only; None where it has them all."""
    if scene.method == "classic":
        return "the classic method's constants belong to its spacings"
    if any(w.count for w in scene.water):
        return "its water has an exact number of particles"
    return None


def scaled(scene: Scene, quality: Quality) -> Scene:
    """The scene at that quality, not checked again."""
    layers = [
        layer.model_copy(
            update={
                "mass": layer.mass and layer.mass * quality.spacing**3,
                "spacing": layer.spacing and layer.spacing * quality.spacing,
            }
        )
        for layer in scene.layers
    ]
    given = scene.projection.model_fields_set
    wanted = {"motion_tolerance": quality.motion_tolerance, "cfl": quality.cfl}
    update = {name: value for name, value in wanted.items() if name not in given}
    projection = scene.projection.model_copy(update=update)
    return scene.model_copy(update={"layers": layers, "projection": projection})


def at_quality(scene: Scene, quality: str, where: str) -> Scene:
    """The scene at that step of the ladder. Raises SceneError, which names the scene as `where`, if
    it has one quality only and another is asked for, or for particles that do not fit."""
    if quality == AS_GIVEN:
        return scene
    why = fixed(scene)
    if why:
        raise SceneError(where, f"it has one quality, {AS_GIVEN}: {why}", "--quality")
    found = scaled(scene, LADDER[quality])
    check(found, where)
    return found


def coarser(scene: Scene, factors: list[float], where: str) -> list[tuple[float, Scene]]:
    """The scene with spacings larger by each factor, all else as it is. Raises SceneError, which
    names the scene as `where`, if its spacings cannot change or such particles do not fit."""
    why = fixed(scene)
    if why:
        raise SceneError(where, f"its spacings cannot change: {why}", "--converge")
    own = scene.projection
    found = [
        (factor, scaled(scene, Quality(factor, own.motion_tolerance, own.cfl)))
        for factor in factors
    ]
    for factor, each in found:
        check(each, f"{where} with {factor:.2f} times its spacings")
    return found


@dataclass(frozen=True)
class Cost:
    """What a run was measured to cost on the machine of `python bench/quality.py`.

    particles: most at once. dearest (-): wall-clock over simulated time of the water's dearest half
    second; error (-): of its centre of mass, over the height of the water.
    """

    particles: int
    dearest: float
    error: float


def costs(name: str) -> dict[str, Cost]:
    """Of a shipped scene, by quality; empty for a scene that was not measured."""
    known = _measured()["scenes"].get(name, {})
    return {
        quality: Cost(int(row["particles"]), row["dearest"], row["error"])
        for quality, row in known.items()
    }


def choose(scene: Scene, name: str, speed: float, display: float = 0.0) -> str:
    """The finest quality whose water keeps real time on a machine that sums over `speed` neighbours
    per second, else the coarsest; AS_GIVEN for scenes that have one only.

    A scene whose water is that of the shipped one called `name` costs what that was measured to.
    display [s]: processor time that a picture takes to be shown. Threads of the water wait for each
    other, so that what one core is taken for counts as if all were.
    """
    if fixed(scene):
        return AS_GIVEN
    slower = _measured()["neighbours_per_second"] / speed
    share = WATER_SHARE * max(1.0 - LEAST_RATE * display, 0.0)
    known = costs(name)
    if known:
        shipped = load_scene(name)
        same = all(getattr(scene, part) == getattr(shipped, part) for part in WATER)
        known = known if same else {}
    for quality in reversed(LADDER):
        dearest = known[quality].dearest if quality in known else estimate(scene, quality)
        if slower * dearest <= share:
            return quality
    return next(iter(LADDER))


def estimate(scene: Scene, quality: str) -> float:
    """Wall-clock over simulated time (-) of a scene that was not measured, as if its water fell
    through its box: by the measured dam break, in proportion to particles and to steps."""
    known = costs("dam_break")[AS_GIVEN]
    found = scaled(scene, LADDER[quality])
    finest = min(s.spacing for s in layer_specs(found))
    rate = math.sqrt(float(np.linalg.norm(found.gravity)) * found.box.size[1]) / finest
    particles = settled_count(found)
    return known.dearest * (particles / known.particles) * (rate / DAM_BREAK_RATE)


def _measured() -> dict:
    """The file that `python bench/quality.py` writes."""
    return json.loads((assets() / "quality.json").read_text(encoding="utf-8"))
