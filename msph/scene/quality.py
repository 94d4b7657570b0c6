"""The quality ladder: the same scene with larger or smaller particles."""

import json
from dataclasses import dataclass

from msph.options import AS_GIVEN, QUALITIES
from msph.scene.check import check
from msph.scene.errors import SceneError
from msph.scene.library import assets
from msph.scene.schema import Scene


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
STEPS = (
    Quality(2.0 ** (2.0 / 3.0), 0.03, 0.8),
    Quality(2.0 ** (1.0 / 3.0), 0.03, 0.8),
    Quality(1.0),
    Quality(2.0 ** (-1.0 / 3.0)),
)
LADDER = dict(zip(QUALITIES, STEPS, strict=True))


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
    """Of a shipped scene, by quality; empty for a scene that was not measured. The file is what
    `python bench/quality.py` writes."""
    known = json.loads((assets() / "quality.json").read_text(encoding="utf-8"))
    return {
        quality: Cost(int(row["particles"]), row["dearest"], row["error"])
        for quality, row in known.get(name, {}).items()
    }
