"""The quality ladder: the same scene with larger or smaller particles, for the machine at hand."""

from dataclasses import dataclass

from msph.scene.check import check
from msph.scene.schema import Scene


@dataclass(frozen=True)
class Quality:
    """One step of the ladder, whose settings are those that `python bench/quality.py` found best.

    spacing (-): factor of all spacings. smoothing: support over spacing of layers that give none.
    motion_tolerance (-): share of the motion that the pressure solve may leave, where the scene
    gives none.
    """

    spacing: float
    smoothing: float
    motion_tolerance: float


# From coarse to fine; "large" is what scenes say. Each step has half the particles of the next.
LADDER = {
    "small": Quality(2.0 ** (2.0 / 3.0), 2.45, 0.01),
    "medium": Quality(2.0 ** (1.0 / 3.0), 2.45, 0.01),
    "large": Quality(1.0, 2.45, 0.01),
    "finest": Quality(2.0 ** (-1.0 / 3.0), 2.45, 0.01),
}
# What a scene is if nobody asks for anything.
AS_GIVEN = "large"


def fixed(scene: Scene) -> str | None:
    """Why the scene has one quality only; None where it has them all."""
    if scene.method == "classic":
        return "the classic method's constants belong to its spacings"
    if any(w.count for w in scene.water):
        return "its water has an exact number of particles"
    return None


def scaled(scene: Scene, quality: Quality, where: str) -> Scene:
    """The scene at that quality. Raises SceneError, which names the scene as `where`, for layers
    that its box cannot hold."""
    layers = [
        layer.model_copy(
            update={
                "mass": layer.mass and layer.mass * quality.spacing**3,
                "spacing": layer.spacing and layer.spacing * quality.spacing,
                "smoothing": layer.smoothing or quality.smoothing,
            }
        )
        for layer in scene.layers
    ]
    projection = scene.projection
    if "motion_tolerance" not in projection.model_fields_set:
        projection = projection.model_copy(update={"motion_tolerance": quality.motion_tolerance})
    found = scene.model_copy(update={"layers": layers, "projection": projection})
    check(found, where)
    return found
