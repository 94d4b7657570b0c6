"""Files saved by a key in the window: images, clips, and checkpoints that can be reopened."""

import time
from concurrent.futures import Future
from pathlib import Path

import imageio.v2 as imageio

from msph.errors import LostOutputError
from msph.own_files import SCENE_SUFFIX, free_stem, replace, replacing
from msph.scene.load import to_toml
from msph.scene.schema import Scene
from msph.stage.clip import Clip
from msph.stage.layout import Layout
from msph.stage.preparation import say
from msph.stage.row import Row

# Actions that a Saver implements.
SAVING = ("picture", "clip", "keep", "reopen")
# Simulations side by side, restored one by one, would no longer be in step.
SINGLE = "checkpoints need a single simulation"


class Saver:
    """Saves files in a folder, named by scene and time, each with its current scene and quality
    next to it; shows a message for every file or error."""

    def __init__(self, layout: Layout, clip: Clip, scene: str, quality: str):
        self.layout, self.clip = layout, clip
        self.folder, self.scene, self.quality = Path("out"), scene, quality
        self.clips: list[Future[Path]] = []

    def act(self, action: str, row: Row) -> None:
        """Carries out one of SAVING."""
        single = len(row.shows) == 1 or action in ("picture", "clip")
        try:
            message = getattr(self, f"_{action}")(row) if single else SINGLE
        except (LostOutputError, OSError) as error:
            message = str(error)
        if message:
            self.layout.show_message(message)

    def _picture(self, row: Row) -> str:
        """Saves the current image at full scale, with its legend, without the window's pages."""
        scale, row.scale = row.scale, 1.0
        row.draw()
        pixels = row.to_numpy_u8()
        row.scale = scale
        path = self._path(".png", row.lead.scene)
        with replacing(path) as new:
            # A higher level makes the window wait twice as long for 0.8 of the size.
            imageio.imwrite(new, pixels, compress_level=1)
        return f"{path}"

    def _clip(self, row: Row) -> str:
        """Begins to write a video of the last seconds."""
        if not self.clip.frames:
            return ""
        path = self._path(".mp4", row.lead.scene)
        self.clips.append(self.clip.write(path))
        return f"writing {path}"

    def report(self) -> None:
        """Shows a message for each clip that is complete or lost."""
        for clip in [c for c in self.clips if c.done()]:
            self.clips.remove(clip)
            self.layout.show_message(str(clip.exception() or clip.result()))

    def close(self) -> None:
        """Waits for all clips."""
        self.clip.close()
        for clip in self.clips:
            say(f"{clip.exception() or clip.result()}")
        self.clips.clear()

    def _keep(self, row: Row) -> str:
        """Saves a checkpoint."""
        row.lead.keep(self._path(".npz", row.lead.scene))
        return ""

    def _reopen(self, row: Row) -> str:
        """Loads the newest checkpoint of this scene and quality."""
        found = self.folder.glob(f"{self.scene}_*.npz")
        newest = sorted(found, key=lambda p: p.stat().st_mtime, reverse=True)
        nothing = f"no checkpoint of {self.scene} at quality {self.quality}; k saves one"
        row.lead.reopen(newest, nothing)
        return ""

    def _path(self, suffix: str, scene: Scene) -> Path:
        """Returns an unused file name, and writes the scene next to it."""
        self.folder.mkdir(parents=True, exist_ok=True)
        stem = free_stem(self.folder, f"{self.scene}_{time.strftime('%Y%m%d_%H%M%S')}")
        note = f"quality {self.quality}"
        replace(self.folder / f"{stem}{SCENE_SUFFIX}", to_toml(scene, note))
        return self.folder / f"{stem}{suffix}"
