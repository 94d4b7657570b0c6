"""Scenes given on the command line, and scenes chosen in the window."""

import shlex
from dataclasses import dataclass, field

from msph.scene.load import load_scene
from msph.scene.schema import Scene


@dataclass(frozen=True)
class Choice:
    """A scene (name or file) at a quality; set: live parameters changed by the user."""

    scene: str
    quality: str
    set: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class SceneArguments:
    """The scene on the command line, its overrides, and those of further simulations side by
    side."""

    scene: str
    overrides: tuple[str, ...] = ()
    beside: tuple[str, ...] = ()

    def scenes_of(self, name: str) -> dict[str, Scene]:
        """Returns the scenes to run side by side, by label: with the overrides for the scene on the
        command line, without overrides for any other. Raises SceneError."""
        if name != self.scene:
            return {name: load_scene(name)}
        found = {" ".join(self.overrides) or name: load_scene(name, self.overrides)}
        for text in self.beside:
            found[text] = load_scene(name, (*self.overrides, *shlex.split(text)))
        return found
