"""The optional parts of a scene, used by sliders, `scenes --explain` and benchmarks."""

from dataclasses import dataclass
from typing import Any

from msph.fluid.methods import METHODS
from msph.scene.schema import Scene


@dataclass(frozen=True)
class Part:
    """An optional part. off: values of the parameters, by dotted key, that switch it off. modules:
    prefix of the modules that hold its kernels, "" if it has none of its own."""

    name: str
    off: dict[str, Any]
    modules: str = ""

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


_PROJECTION = "msph.fluid.projection"
PARTS = (
    Part("adaptation", {"adaptation.enabled": False}, "msph.fluid.adaptivity"),
    Part("bodies", {"bodies": [], "container": None, "wavemakers": []}, "msph.fluid.boundary"),
    # Walls without slip act through viscosity.
    Part(
        "viscosity",
        {"projection.viscosity": 0.0, "projection.slip": True},
        f"{_PROJECTION}.visc",
    ),
    Part("tension", {"projection.tension": 0.0}, f"{_PROJECTION}.surface_tension"),
    Part("shear relief", {"projection.shear_relief": 0.0}, f"{_PROJECTION}.shear_relief"),
    Part("xsph", {"projection.xsph": 0.0}, f"{_PROJECTION}.xsph"),
    Part("caustics", {"picture.caustics": False}),
    Part("whitewater", {"picture.whitewater": False}, "msph.surface.whitewater"),
    Part("wet walls", {"picture.drying": 0.0}, "msph.picture.wetness"),
    Part("ripples", {"picture.ripples": False}, "msph.picture.ripples"),
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
