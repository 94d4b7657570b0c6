"""Qualities of a scene: the same scene with larger or smaller particles."""

import json
from dataclasses import dataclass

from msph.options import AS_GIVEN, QUALITIES
from msph.scene.check import check
from msph.scene.errors import SceneError
from msph.scene.library import assets
from msph.scene.schema import Scene


@dataclass(frozen=True)
class Quality:
    """A quality. spacing (-): factor of all spacings. motion_tolerance (-): tolerance of the
    pressure solve relative to the motion, and cfl: limit of the distance per step, in spacings;
    both apply only if the scene does not set them."""

    spacing: float
    motion_tolerance: float = 0.01
    cfl: float = 0.5


# Qualities from coarse to fine; each has half the particle volume of the one before, and "large"
# has the scene's own spacings. Looser tolerances and longer steps are Pareto-optimal for still and
# sloshing water, not for dam breaks (bench/results/pareto.md). Smaller supports cost more at equal
# error (bench/results/quality_settings.md).
LADDER = dict(
    zip(
        QUALITIES,
        (
            Quality(2.0 ** (2.0 / 3.0), 0.03, 0.8),
            Quality(2.0 ** (1.0 / 3.0), 0.03, 0.8),
            Quality(1.0),
            Quality(2.0 ** (-1.0 / 3.0)),
        ),
        strict=True,
    )
)


def single_quality_reason(scene: Scene) -> str | None:
    """Returns the reason why the scene has only one quality, or None if it has all."""
    if scene.method == "classic":
        return "the constants of the classic method are set for its spacings"
    if any(w.count for w in scene.water):
        return "its number of particles is given"
    return None


def scaled(scene: Scene, quality: Quality) -> Scene:
    """Returns the scene at that quality, unchecked."""
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
    """Returns the checked scene at that quality. Raises SceneError, with `where` as the scene's
    name, if the scene has only one quality or its particles do not fit the box."""
    if quality == AS_GIVEN:
        return scene
    why = single_quality_reason(scene)
    if why:
        raise SceneError(where, f"has only the quality {AS_GIVEN}: {why}", "--quality")
    found = scaled(scene, LADDER[quality])
    check(found, where)
    return found


def with_spacings(scene: Scene, factors: list[float], where: str) -> list[tuple[float, Scene]]:
    """Returns the scene with its spacings multiplied by each factor. Raises SceneError, with
    `where` as the scene's name, if its spacings cannot change or its particles do not fit."""
    why = single_quality_reason(scene)
    if why:
        raise SceneError(where, f"spacings cannot change: {why}", "--converge")
    own = scene.projection
    found = [
        (factor, scaled(scene, Quality(factor, own.motion_tolerance, own.cfl)))
        for factor in factors
    ]
    for factor, each in found:
        check(each, f"{where} with spacings multiplied by {factor:.2f}")
    return found


@dataclass(frozen=True)
class Cost:
    """Measured cost of a run, by `python bench/run.py quality`. particles: largest number. slowest
    (-): elapsed over simulated time in the slowest half second. error (-): of the centre of mass,
    over the water's height."""

    particles: int
    slowest: float
    error: float


def costs(name: str) -> dict[str, Cost]:
    """Returns the costs of a shipped scene by quality, from the file that
    `python bench/run.py quality` writes; empty if the scene was not measured."""
    known = json.loads((assets() / "quality.json").read_text(encoding="utf-8"))
    return {
        quality: Cost(int(row["particles"]), row["slowest"], row["error"])
        for quality, row in known.get(name, {}).items()
    }
