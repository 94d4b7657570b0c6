"""Scenes given on the command line, and scenes chosen in the window."""

import shlex
from dataclasses import dataclass, field
from pathlib import Path

from msph.scene.library import find_scene, shipped_scenes
from msph.scene.load import load_scene
from msph.scene.schema import Scene


@dataclass(frozen=True)
class Choice:
    """A scene (name or file) at a quality; set: live parameters changed by the user; found: the
    quality selected for AUTO; resume: checkpoint to continue from."""

    scene: str
    quality: str
    set: dict[str, float] = field(default_factory=dict)
    found: str = ""
    resume: Path | None = None

    @property
    def quality_now(self) -> str:
        """Quality of the simulations."""
        return self.found or self.quality


def full_name(scene: str) -> str:
    """Returns a scene's name, or its path for any working directory. Raises SceneError."""
    return scene if scene in shipped_scenes() else str(find_scene(scene).resolve())


@dataclass(frozen=True)
class SceneArguments:
    """The scene on the command line, its overrides, and the overrides of further simulations side
    by side."""

    scene: str
    overrides: tuple[str, ...] = ()
    beside: tuple[str, ...] = ()

    def overrides_of(self, name: str) -> tuple[str, ...]:
        """Returns the overrides of a scene."""
        return self.overrides if name in (self.scene, full_name(self.scene)) else ()

    def scenes_of(self, name: str) -> dict[str, Scene]:
        """Returns the scenes to run side by side, by label: with the overrides for the scene on the
        command line, without overrides for any other. Raises SceneError."""
        own = self.overrides_of(name)
        found = {" ".join(own) or name: load_scene(name, own)}
        for text in self.beside if name == self.scene else ():
            found[text] = load_scene(name, (*self.overrides, *shlex.split(text)))
        return found
