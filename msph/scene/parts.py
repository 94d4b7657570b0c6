"""The optional parts of a scene, used by sliders and `scenes --explain`."""

from dataclasses import dataclass
from typing import Any

from msph.fluid.methods import METHODS
from msph.scene.schema import Scene


@dataclass(frozen=True)
class Part:
    """An optional part. off: values of the parameters, by dotted key, that switch it off."""

    name: str
    off: dict[str, Any]

    @property
    def picture(self) -> bool:
        """True if the part changes only the image."""
        return all(key.startswith("picture.") for key in self.off)

    def active(self, scene: Scene) -> bool:
        """Returns True if the scene has this part."""
        sections = {key.partition(".")[0] for key in self.off}
        if sections & METHODS.keys() - {scene.method}:
            return False
        return any(value_of(scene, key) != off for key, off in self.off.items())

    def without(self, scene: Scene) -> Scene:
        """Returns the scene with this part switched off."""
        for key, off in self.off.items():
            scene = with_value(scene, key, off)
        return scene


PARTS = (
    Part("adaptation", {"adaptation.enabled": False}),
    Part("bodies", {"bodies": [], "container": None, "wavemakers": []}),
    # Walls without slip act through viscosity.
    Part("viscosity", {"projection.viscosity": 0.0, "projection.slip": True}),
    Part("tension", {"projection.tension": 0.0}),
    Part("shear relief", {"projection.shear_relief": 0.0}),
    Part("caustics", {"picture.caustics": False}),
    Part("whitewater", {"picture.whitewater": False}),
    Part("wet walls", {"picture.drying": 0.0}),
    Part("ripples", {"picture.ripples": False}),
    Part("supersample", {"picture.supersample": 1}),
)


def value_of(scene: Scene, key: str) -> Any:
    """Returns the value of a parameter by its dotted key."""
    value: Any = scene
    for name in key.split("."):
        value = getattr(value, name)
    return value


def with_value(scene: Scene, key: str, value: Any) -> Scene:
    """Returns the scene, unchecked, with another value of a parameter by its dotted key."""
    section, _, name = key.rpartition(".")
    if not section:
        return scene.model_copy(update={name: value})
    part = getattr(scene, section).model_copy(update={name: value})
    return scene.model_copy(update={section: part})
