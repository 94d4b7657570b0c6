"""What is played in a window: a scene at a quality, and the waters that there are of it."""

from collections.abc import Callable
from dataclasses import dataclass, field

from msph.scene.schema import Scene

# The waters that are shown of a scene, by their labels. Raises SceneError.
WatersOf = Callable[[str], dict[str, Scene]]


@dataclass(frozen=True)
class Choice:
    """A scene by name or file, at a quality; set: live parameters that somebody has changed."""

    scene: str
    quality: str
    set: dict[str, float] = field(default_factory=dict)
