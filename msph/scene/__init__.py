"""Scenes: declared parameters, the TOML files that set them, and the particles they describe."""

from msph.scene.build import build_simulation
from msph.scene.errors import SceneError
from msph.scene.load import load_scene
from msph.scene.schema import Scene

__all__ = ["Scene", "SceneError", "build_simulation", "load_scene"]
