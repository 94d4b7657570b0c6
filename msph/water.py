"""Simulations in scripts and notebooks: what msph.open() returns."""

import math
import os
import warnings
import weakref
from collections.abc import Iterable, Iterator, Mapping
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from PIL import Image

from msph.cli import check_values
from msph.errors import BadInputError
from msph.export.meshes import body_mesh, surface_mesh
from msph.export.outputs import Outputs, check_files, check_outputs
from msph.measure.frame import BodyState, Frame, Particles, Reader
from msph.measure.probes import build_probes
from msph.options import RunOptions
from msph.own_files import replacing_all, writing
from msph.scene.bodies import names, number_of
from msph.scene.check import cautions
from msph.scene.load import TABLES, load_scene, with_probe
from msph.scene.schema import Scene
from msph.stage.controls import Controls
from msph.stage.headless import Headless
from msph.stage.loaded_scene import at, smooth
from msph.stage.loop import run
from msph.stage.preparation import compiling
from msph.stage.recorder import Recorder
from msph.stage.row import Row
from msph.stage.show import Show

__all__ = ["Body", "BodyState", "Frame", "Particles", "Water"]
# Simulated time of a frame, and between measurements of the solver residual, which is slow [s].
FRAME, RESIDUAL_EVERY = 1.0 / 60.0, 0.1
Files = str | os.PathLike | Iterable[str | os.PathLike]
# Simulations whose state is on the device; each has fields (a World) of its own.
_running: "weakref.WeakSet[Water]" = weakref.WeakSet()


class Body:
    """A body of a simulation. Its BodyState at the present time are attributes: body.position."""

    def __init__(self, water: "Water", name: str, number: int):
        self.name, self._number, self._water = name, number, weakref.proxy(water)

    def push(self, force: ArrayLike, at: ArrayLike | None = None) -> None:
        """Applies a force [N] at a point [m] (default: the centre) during the next frame; forces of
        several calls add up. Raises MsphError for a body that does not float, or if these are not
        three finite numbers each."""
        if math.isinf(self.mass):
            raise BadInputError(f"{self.name}: does not float; give it a density or a mass")
        problem = f"{self.name}: force and point are three finite numbers each"
        given = _finite([force, self.position if at is None else at], (2, 3), problem)
        twist = np.cross(given[1] - self.position, given[0])
        self._water._pushes[self._number] += [*given[0], *twist]

    @property
    def mass(self) -> float:
        """Mass [kg]; infinite for a body that does not float."""
        mass = self._water._awake.simulation.boundary.bodies[self._number].mass
        return math.inf if mass is None else mass

    def mesh(self) -> Any:
        """Returns the body at its present pose as a trimesh.Trimesh [m]."""
        return body_mesh(self._water._awake.simulation, self._number)

    def __getattr__(self, name: str) -> np.ndarray:
        if name not in BodyState._fields:
            raise AttributeError(f"a body has no attribute {name!r}")
        return getattr(self._water.frame.bodies[self.name], name)


class Bodies(dict[str, Body]):
    """Bodies by name, such as "duck", or by key in the scene, such as "bodies.0"."""

    def __init__(self, water: "Water"):
        super().__init__({name: Body(water, name, k) for k, name in enumerate(names(water.scene))})
        self._scene = water.scene

    def __missing__(self, key: str) -> Body:
        return list(self.values())[number_of(self._scene, key)]


class Water(AbstractContextManager):
    """Simulation of a scene, made by msph.open().

    scene: all its parameters. bodies: by name. tilt (roll about z, pitch about x) [rad]: rotation
    of the box in the next frames, added to the scene's. Any number may be open at once: those of
    similar size share fields and compiled kernels, so that the first use after another simulation
    takes some 10 ms, and foam and wetness of images begin anew. Methods raise MsphError.
    """

    def __init__(self, scene: Any, quality: str, given: Mapping[str, Any], arch: str, threads: Any):
        check_values("capture", quality=quality, arch=arch, threads=threads)
        tables = dict(scene) if isinstance(scene, Mapping) else None
        self.name = TABLES if tables else os.fspath(scene)
        loaded = smooth(load_scene(tables or self.name, dict(given)))
        self.scene: Scene = at(loaded, self.name, RunOptions((), arch, threads, quality)).scene
        for caution in cautions(self.scene):
            warnings.warn(caution, stacklevel=3)
        _park(list(_running))
        with compiling(None):
            self._show: Any = Show(self.scene, FRAME, density_every=RESIDUAL_EVERY)
        _running.add(self)
        self.bodies, self.tilt = Bodies(self), (0.0, 0.0)
        self._size: tuple[int, int] | None = None
        self._begin()

    def _begin(self) -> None:
        self._reader = Reader(self._show.simulation, [*self.bodies], self._show.snapshot)
        self._frame: Frame | None = None
        self._reader.probes = build_probes(self.scene)
        self._pushes = np.zeros((len(self.bodies), 6))  # [N, N m], in the next frame

    @property
    def _awake(self) -> Show:
        """The show, with its state on the device."""
        if self._show is None:
            raise BadInputError(f"{self.name}: the simulation is closed")
        if self not in _running:
            world = self._show.simulation.world
            _park([w for w in _running if w._show.simulation.world is world])
            self._show.simulation.unpark()
            self._show.load(self._size)
            _running.add(self)
        return self._show

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return float(self._awake.simulation.time)

    @property
    def frame(self) -> Frame:
        """The water now."""
        show = self._awake
        if not show.ledger.entries:
            show.ledger.record(show.gravity())
        if self._frame is None:
            self._frame = self._reader.read(show.ledger.entries[-1])
        return self._frame

    def probe(self, kind: str, name: str | None = None, **place: Any) -> None:
        """Adds a probe, whose readings are in all later frames under its name, by default its kind.

        kind and place: "height" at=(x, z) [m]; "pressure" and "velocity" point=(x, y, z) [Pa, m/s];
        "pressure" (a mean) and "flux" lo=, hi= corners of a rectangle [Pa, m^3/s]; "front"
        axis="+x" [m]; "force" body="duck" [N, N m]. docs/scenes.md explains them.
        """
        given = {"kind": kind, "name": name or kind, **place}
        self.scene = with_probe(self.scene, given, self.name)
        self._reader.probes += build_probes(self.scene)[len(self._reader.probes) :]
        self._frame = None

    def frames(self, seconds: float | None = None, step: float = FRAME) -> Iterator[Frame]:
        """Advances the water by `seconds` [s], by default to the scene's duration, and yields the
        frame after each `step` [s]."""
        for _ in range(self._count(seconds, step)):
            yield self._advance(step)

    def _count(self, seconds: float | None, step: float) -> int:
        left = max(self.scene.duration - self.time, step) if seconds is None else seconds
        check_values("capture", seconds=left)
        check_values("capture", seconds=step)
        return max(1, round(left / step))

    def _advance(self, step: float, draw: bool = False) -> Frame:
        """Advances the water by one frame of `step` [s]."""
        # Checked first: an error keeps the pushes.
        roll, pitch = _finite(self.tilt, (2,), "tilt: is two finite numbers").tolist()
        floating, _ = self._awake.simulation.boundary.floating, self.frame
        floating.applied, self._frame = self._pushes[floating.which], None
        try:
            controls = Controls(frame_time=step, tilt=(roll, pitch), hidden=not draw)
            run(Row([self._show]), Headless(1, controls))
        finally:
            self._pushes[:], floating.applied = 0.0, np.zeros((floating.count, 6))
        return self.frame

    def image(self, width: int = 960, height: int = 540) -> np.ndarray:
        """Returns an image, (height, width, 3) uint8, the first row at the top. The scene has the
        camera and the view: set={"camera.azimuth": 30, "picture.view": "pressure"} in open()."""
        check_values("capture", size=f"{width}x{height}")
        show = self._awake
        with compiling(None):
            if self._size != (width, height):
                self._size = width, height
                show.load(self._size)
            show.draw()
        return show.display.picture.to_numpy_u8()

    def show(self, width: int = 960, height: int = 540) -> Any:
        """Returns an image as a PIL.Image, which notebooks display."""
        return Image.fromarray(self.image(width, height))

    def mesh(self, layer: bool = False) -> Any:
        """Returns the surface as a closed trimesh.Trimesh [m] with vertex_attributes: velocity
        (n, 3) [m/s], foam (n,), the covered share from the first mesh or image on, and, if asked
        for, layer (n,)."""
        show = self._awake
        return surface_mesh(show.extracted(), show.simulation, show.display.whitewater, layer)

    def save(self, file: str | os.PathLike) -> None:
        """Writes a checkpoint (.npz), from which load() and --resume of the commands continue."""
        state: dict[str, Any] = self._awake.simulation.state()
        with replacing_all([Path(file)]), writing(Path(file)):
            np.savez_compressed(os.fspath(file), **state)

    def load(self, file: str | os.PathLike) -> None:
        """Continues from a checkpoint of this scene."""
        check_values("capture", resume=os.fspath(file))
        self._awake.resume(Path(file))
        self._begin()

    def reset(self) -> None:
        """Returns to time zero."""
        self._awake.reset()
        self._begin()

    def record(
        self,
        files: Files = (),
        seconds: float | None = None,
        fps: float = 30.0,
        size: tuple[int, int] = (1280, 720),
        **data: Files,
    ) -> list[Path]:
        """Advances the water by `seconds` [s], by default to the scene's duration, and records it
        as `msph capture` does. Replaces existing files; returns the paths of those written.

        files: video (.mp4 .mov .mkv .webm), animation (.webp .gif), last image (.png) or images
        (i_%04d.png) of size (width, height) [pixels], fps per simulated second. data: meshes,
        particles, bodies, droplets, usd: meshes="surface_%04d.ply", usd="film.usdc".
        """
        check_values("capture", fps=fps, size="{}x{}".format(*size))
        show, count = self._awake, self._count(seconds, 1.0 / fps)
        more: dict[str, Any] = {kind: _paths(given) for kind, given in data.items()}
        outputs = Outputs(_paths(files), **more)
        check_outputs(outputs, fps, self.scene.picture.alpha, bool(self.bodies))
        paths = outputs.names(0, count)
        check_files(paths, [])
        display, self._size = show.display, size if outputs.pictures else None
        display.meshes, display.sprayed = outputs.surface, outputs.sprayed
        show.load(self._size)
        with replacing_all(paths):
            recorder = Recorder(outputs, count, fps, bar=False, aspect=size[0] / size[1])
            row = Row([show])
            try:
                while recorder.wants_more(row):
                    self._advance(1.0 / fps, draw=True)
                    recorder.observe(row)
            finally:
                recorder.close()
                display.meshes, display.sprayed = False, True
            return recorder.kept()

    def close(self) -> None:
        """Frees the memory of the simulation, which then cannot be used."""
        if self._show is not None:
            self._show.close()
            _running.discard(self)
            self._show = None

    def __exit__(self, *_: Any) -> None:
        self.close()


def _park(waters: list[Water]) -> None:
    for water in waters:
        water._show.simulation.park()
        _running.discard(water)


def _paths(given: Files) -> list[Path]:
    return [Path(p) for p in ([given] if isinstance(given, str | os.PathLike) else given)]


def _finite(values: Any, shape: tuple[int, ...], problem: str) -> np.ndarray:
    """Returns values as an array of finite numbers; raises MsphError if they are no such array."""
    try:
        found = np.array(values, float)
    except (TypeError, ValueError):
        found = np.array(math.nan)
    if found.shape != shape or not np.isfinite(found).all():
        raise BadInputError(problem)
    return found
