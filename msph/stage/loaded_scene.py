"""Scenes as commands load them, and what commands that run a simulation have in common."""

from dataclasses import dataclass
from typing import Any

import click

from msph.device import start
from msph.measure.past import particles_in
from msph.options import AUTO, RunOptions
from msph.scene.load import to_toml
from msph.scene.parts import with_value
from msph.scene.quality import at_quality
from msph.scene.schema import Scene
from msph.stage.input_relays import Replayer
from msph.stage.loop import Audience
from msph.stage.recorded_input import Recording
from msph.stage.show import SIMULATED
from msph.stage.trial import finest_in_real_time

# Rays per pixel along each axis in recordings, which need not be made in real time.
SMOOTH = 2


@dataclass(frozen=True)
class LoadedScene:
    """A scene at a quality, its name and overrides on the command line, and the architecture."""

    scene: Scene
    name: str
    quality: str
    arch: str
    overrides: tuple[str, ...]

    def toml(self) -> str:
        """Returns the text of the scene's file."""
        return to_toml(self.scene, f"quality {self.quality}")


def at(scene: Scene, name: str, run: RunOptions) -> LoadedScene:
    """Starts Taichi and returns the scene at the quality of the options."""
    arch, quality = start(run.arch, run.threads), run.quality
    if quality == AUTO:
        quality = finest_in_real_time(scene, name)
    return LoadedScene(at_quality(scene, quality, name), name, quality, arch, run.overrides)


def smooth(scene: Scene) -> Scene:
    """Returns the scene for images that need not be made in real time."""
    given = "supersample" in scene.picture.model_fields_set
    return scene if given else with_value(scene, "picture.supersample", SMOOTH)


def options_of(recording: Recording | None, resume: str | None = None) -> dict[str, Any]:
    """Returns the options of a show: with recorded input, the options of its recording; otherwise
    room for the particles of a checkpoint, if any, to which a user may have added water."""
    return SIMULATED if recording else {"room": particles_in(resume)}


def with_input(audience: Audience, recording: Recording | None) -> Audience:
    """Returns the audience with recorded input, if any; see Replayer."""
    return Replayer(audience, recording) if recording else audience


def exclude(one: str, given: object, other: str, also: object) -> None:
    """Raises UsageError if two options that exclude each other are given."""
    if given and also:
        raise click.UsageError(f"{one} and {other} exclude each other")
