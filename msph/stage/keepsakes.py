"""What the user takes from a simulation: pictures, clips, and water to go on with."""

import contextlib
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import imageio.v2 as imageio
import numpy as np

from msph.own_files import replace, replacing, with_digest
from msph.scene.errors import SceneError
from msph.scene.load import to_toml
from msph.scene.schema import Scene
from msph.stage.replay import Replay
from msph.stage.row import Row, Show


class Keepsakes:
    """Files in a folder, named by the scene and the time; beside each its scene as it was then,
    with what was changed in it, and the quality. Each method returns a line that says what was
    done, and raises LostOutputError for what cannot be written."""

    def __init__(self, folder: Path, scene: str, quality: str):
        self.folder, self.scene, self.quality = folder, scene, quality
        self.image: Any = None  # what a clip draws

    def picture(self, row: Row) -> str:
        """The picture as it was drawn last, with its legend, without the window's pages."""
        scale, row.picture.scale = row.picture.scale, 1.0
        row.draw()
        pixels = row.picture.to_numpy_u8()
        row.picture.scale = scale
        path = self._path(".png", row.lead.scene)
        with replacing(path) as new:
            imageio.imwrite(new, pixels)
        return f"{path}"

    def clip(self, row: Row, replay: Replay, tell: Callable[[float], None]) -> str:
        """A video of the last seconds; tell: called with the share (0 to 1) of it that there is."""
        path = self._path(".mp4", row.lead.scene)

        def told(share: float) -> None:
            self.image = row.picture.image
            tell(share)

        replay.write(row, path, told)
        return f"{path}"

    def water(self, show: Show) -> str:
        """A checkpoint of the water."""
        path, state = self._path(".npz", show.scene), show.simulation.state()
        with replacing(path) as new:
            np.savez_compressed(new, **state)  # type: ignore[arg-type]
        return f"{path}; o opens it"

    def reopen(self, show: Show) -> str:
        """Goes on with the water of this scene, at this quality, that was kept last. Raises
        SceneError where none was."""
        kept = self.folder.glob(f"{self.scene}_*.npz")
        for path in sorted(kept, key=lambda p: p.stat().st_mtime, reverse=True):
            # That of another quality has other layers.
            with contextlib.suppress(SceneError):
                show.resume(path)
                return f"{path}, of {show.simulation.time:.2f} s"
        what = f"no water of {self.scene} was kept at quality {self.quality}; k keeps some"
        raise SceneError(str(self.folder), what)

    def _path(self, suffix: str, scene: Scene) -> Path:
        """A new file, with its scene beside it."""
        self.folder.mkdir(parents=True, exist_ok=True)
        stem = f"{self.scene}_{time.strftime('%Y%m%d_%H%M%S')}"
        taken, number = stem, 1
        while list(self.folder.glob(f"{taken}.*")):
            number += 1
            taken = f"{stem}_{number}"
        note = f"quality {self.quality}"
        replace(self.folder / f"{taken}.scene.toml", with_digest(to_toml(scene, note)))
        return self.folder / f"{taken}{suffix}"
