"""The shipped scenes: their folder, names and files."""

import os
from pathlib import Path

from msph.errors import did_you_mean
from msph.scene.errors import SceneError


def assets() -> Path:
    """Returns the assets folder: next to the package in a checkout, inside an installed package."""
    package = Path(__file__).resolve().parent.parent
    inside = package / "assets"
    return inside if inside.is_dir() else package.parent / "assets"


def shipped_scenes() -> dict[str, Path]:
    """Returns the files of the shipped scenes by name, in alphabetic order."""
    return {p.stem: p for p in sorted((assets() / "scenes").glob("*.toml"))}


def find_scene(name: str) -> Path:
    """Returns the file of a scene given as a path or a shipped name. Raises SceneError."""
    scenes = shipped_scenes()
    if name in scenes:
        return scenes[name]
    path = Path(name)
    # os.path.isfile and isdir are False for names that are too long, where Path.is_file raises.
    if os.path.isfile(path):
        return path
    if os.path.isdir(path):
        raise SceneError(name, "is a folder, not a scene file")
    hint = did_you_mean(name, scenes, "shipped")
    raise SceneError(name, f"no such scene file or shipped scene; {hint}")
