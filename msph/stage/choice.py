"""What is played in a window: a scene at a quality, and the waters that there are of it."""

import shlex
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from msph.interrupts import importing

if TYPE_CHECKING:
    # The process of the window knows choices, but no scenes.
    from msph.scene.schema import Scene

# The waters that are shown of a scene, by their labels. Raises SceneError.
WatersOf = Callable[[str], "dict[str, Scene]"]


@dataclass(frozen=True)
class Choice:
    """A scene by name or file, at a quality; set: live parameters that somebody has changed."""

    scene: str
    quality: str
    set: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Called:
    """How `play` was called: with a scene, overrides, and those of each water beside it, as texts;
    on an architecture, with a number of threads; frames: most of them; size (width, height)
    [pixels]."""

    scene: str
    overrides: tuple[str, ...]
    beside: tuple[str, ...]
    arch: str
    threads: int | None
    frames: int | None
    size: tuple[int, int]

    def waters_of(self, name: str) -> "dict[str, Scene]":
        """Of the scene that was called, as it was called; of another, as it is written. Raises
        SceneError."""
        with importing():
            from msph.scene.load import load_scene
        if name != self.scene:
            return {name: load_scene(name)}
        waters = {" ".join(self.overrides) or name: load_scene(name, self.overrides)}
        for text in self.beside:
            waters[text] = load_scene(name, (*self.overrides, *shlex.split(text)))
        return waters
