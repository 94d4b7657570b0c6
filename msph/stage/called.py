"""Scenes as `play` was called with them, and scenes that are chosen in its window."""

import shlex
from dataclasses import dataclass, field

from msph.scene.load import load_scene
from msph.scene.schema import Scene


@dataclass(frozen=True)
class Choice:
    """A scene by name or file, at a quality; set: live parameters that the user has changed."""

    scene: str
    quality: str
    set: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class SceneArguments:
    """The scene on the command line, its overrides, and those of each simulation beside it."""

    scene: str
    overrides: tuple[str, ...] = ()
    beside: tuple[str, ...] = ()

    def scenes_of(self, name: str) -> dict[str, Scene]:
        """Returns the scenes to be shown side by side, by their labels: with the overrides where it
        is the scene on the command line, as it is written for any other. Raises SceneError."""
        if name != self.scene:
            return {name: load_scene(name)}
        found = {" ".join(self.overrides) or name: load_scene(name, self.overrides)}
        for text in self.beside:
            found[text] = load_scene(name, (*self.overrides, *shlex.split(text)))
        return found
