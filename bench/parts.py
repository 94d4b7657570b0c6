"""Cost of each optional part of a scene when enabled, and its kernel launches when disabled.

For each part a separate process builds the same tank without the part and with it, and runs both in
alternating frames. The table is in bench/terms.py.
"""

import math
import statistics
import time
from collections import Counter
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
import taichi as ti

from bench.tables import Table
from bench.tanks import FRAME
from bench.water import Ours
from msph.fluid.external_forces import ExternalForces
from msph.launches import watch_launches
from msph.measure.ledger import Ledger
from msph.measure.probes import build_probes
from msph.measure.snapshot import Snapshot
from msph.scene.build import build_simulation
from msph.scene.schema import Scene
from msph.stage.explain import picture_error, water_error
from msph.stage.show import Show
from msph.state import Moment

# A tank of 3,072 particles that sloshes under tilted gravity [m, m/s^2].
SIZE, DEPTH, SPACING, GRAVITY = (0.6, 0.4, 0.4), 0.2, 0.025, (1.5, -9.7, 0.0)
# Image size [pixels]; number of timed frames, and of frames before them.
PICTURE, FRAMES, UNTIMED = (640, 360), 30, 3


@dataclass(frozen=True)
class Case:
    """An optional part. on, off: changes of the tank's scene with the part and without it.
    observer: work after each frame of the tank with the part: "ledger", "probes", "surface" or
    "picture" (surface and image); always: work after each frame of both tanks. modules: prefix of
    the modules whose kernels belong to the part, "" if the part has no kernels of its own. skipped:
    method of the picture that does nothing in the tank without the part."""

    name: str
    on: dict[str, Any] = field(default_factory=dict)
    off: dict[str, Any] = field(default_factory=dict)
    observer: str = ""
    always: str = ""
    modules: str = ""
    skipped: str = ""


LAYERS = [{"spacing": SPACING * 2.0 ** (k / 3.0)} for k in range(3)]
LAYERED = {"layers": LAYERS, "water": [{"layer": 2}]}
BALL = {"centre": [0.4, 0.1, 0.2], "radius": 0.08}
PROBES = [
    {"name": "floor", "kind": "pressure", "point": [0.3, 0.0, 0.2]},
    {"name": "front", "kind": "front", "axis": "+x"},
]
PROJECTION = "msph.fluid.projection"
CASES = (
    Case(
        "adaptation",
        {**LAYERED, "adaptation": {"enabled": True}},
        LAYERED,
        modules="msph.fluid.adaptivity",
    ),
    Case("bodies", {"bodies": [BALL]}, modules="msph.fluid.boundary"),
    Case("viscosity", {"projection": {"viscosity": 1.0}}, modules=f"{PROJECTION}.visc"),
    Case("tension", {"projection": {"tension": 0.072}}, modules=f"{PROJECTION}.surface_tension"),
    Case(
        "shear relief",
        off={"projection": {"shear_relief": 0.0}},
        modules=f"{PROJECTION}.shear_relief",
    ),
    Case("caustics", off={"picture": {"caustics": False}}, always="picture"),
    Case(
        "whitewater",
        off={"picture": {"whitewater": False}},
        always="picture",
        modules="msph.surface.whitewater",
    ),
    Case(
        "wet walls",
        off={"picture": {"drying": 0.0}},
        always="picture",
        modules="msph.picture.wetness",
    ),
    Case(
        "ripples",
        off={"picture": {"ripples": False}},
        always="picture",
        modules="msph.picture.ripples",
    ),
    Case("supersample", {"picture": {"supersample": 2}}, always="picture"),
    Case("ledger", observer="ledger", modules="msph.measure"),
    Case("probes", {"probes": PROBES}, observer="probes", modules="msph.measure"),
    Case("surface", observer="surface", modules="msph.surface"),
    Case("picture, surface included", observer="picture", modules="msph.picture"),
    Case("edges", always="picture", modules="msph.picture.edge_filter", skipped="resolve"),
    Case("refraction", off={"picture": {"refractive_index": 1.0}}, always="picture"),
)


def scene_with(changes: dict[str, Any]) -> Scene:
    """Returns the tank's scene with changes by section."""
    water = {"layer": 0, "lo": [0, 0, 0], "hi": [SIZE[0], DEPTH, SIZE[2]]}
    tank: dict[str, Any] = {
        "box": {"size": SIZE},
        "gravity": GRAVITY,
        "layers": [{"spacing": SPACING}],
        "water": [water | given for given in changes.get("water", [{}])],
    }
    return Scene.model_validate({**tank, **{k: v for k, v in changes.items() if k != "water"}})


class Side:
    """The tank with the part or without it.

    start [s]: CPU time of building, compiling and the first frame. kernels: kernels launched until
    then, as module:Class.kernel. launches: number of launches in the timed frames, by kernel. times
    [s]: elapsed time of each timed frame. centres (3,) [m]: centre of mass after each frame."""

    def __init__(self, changes: dict[str, Any], observer: str):
        self.scene, self.observer = scene_with(changes), observer
        self.kernels: set[str] = set()
        self.launches: Counter[str] = Counter()
        self.times: list[float] = []
        self.centres: list[np.ndarray] = []
        begin = time.process_time()
        with watch_launches(lambda owner, name: self.kernels.add(full_name(owner, name))):
            self._build()
            self.frame()
        self.start = time.process_time() - begin
        self.sim.reset()

    def _build(self) -> None:
        self.show = self.ledger = None
        if self.observer in ("surface", "picture"):
            picture = PICTURE if self.observer == "picture" else None
            self.show = Show(self.scene, FRAME, picture, meshes=True)
            self.sim = self.show.simulation
        else:
            self.sim = build_simulation(self.scene)
        self.sim.warm_up(FRAME)
        if self.observer == "ledger":
            self.ledger = Ledger(self.sim, density_every=math.inf)
        self.probes = build_probes(self.scene) if self.observer == "probes" else []

    def frame(self) -> None:
        """Runs a frame and the work after it."""
        self.sim.advance(FRAME, ExternalForces(gravity=GRAVITY))
        speed = self.ledger.record(GRAVITY).top_speed if self.ledger else math.inf
        if self.probes:
            water = Snapshot.of(self.sim)
            for probe in self.probes:
                probe.read(water)
        if self.show:
            now = Moment(simulated=FRAME, gravity=GRAVITY, top_speed=speed)
            self.show.state.take(self.sim, now)
            self.show.display.advance()
            self.show.display.draw()

    def timed(self) -> None:
        """Runs a timed frame and records the centre of mass after it."""
        ti.sync()
        begin = time.perf_counter()
        with watch_launches(lambda owner, name: self.launches.update([full_name(owner, name)])):
            self.frame()
        ti.sync()
        self.times.append(time.perf_counter() - begin)
        self.centres.append(Ours(self.sim).centre())


def full_name(owner: Any, kernel: str) -> str:
    """Returns module:Class.kernel."""
    return f"{type(owner).__module__}:{type(owner).__name__}.{kernel}"


def measured(part: Case, seed: int) -> dict[str, Any]:
    """Measures a part; returns the cells of its table row."""
    # The first build includes costs shared by all parts, such as loading Taichi's library.
    Side({}, "")
    off = Side(part.off, part.always)
    on = Side(part.on, part.observer or part.always)
    if part.skipped:
        setattr(off.show.display.picture, part.skipped, lambda: None)
    for frame in range(UNTIMED + FRAMES):
        for side in (off, on):
            if frame == UNTIMED:
                side.times.clear()
                side.launches.clear()
            side.timed()

    def own(names: Any) -> list[str]:
        return [name for name in names if part.modules and name.startswith(part.modules)]

    without, with_ = (statistics.median(side.times) for side in (off, on))
    found: dict[str, Any] = {
        "ms per frame, off": 1e3 * without,
        "on": 1e3 * with_,
        "share of the frame": 1.0 - without / with_,
        "additional s at the first start (one run)": on.start - off.start,
    }
    for name, side in (("off", off), ("on", on)):
        launches = sum(side.launches[kernel] for kernel in own(side.launches))
        found[f"own kernels, {name}"] = len(own(side.kernels))
        found[f"own launches per frame, {name}"] = launches / FRAMES
    return {**found, "error without it after 0.5 s": error(part, off, on)}


def error(part: Case, off: Side, on: Side) -> str:
    """Returns the error without the part, in words."""
    if on.show and off.show:
        return f"picture: {picture_error(on.show, off.show)}"
    if part.observer:
        return "none: it only measures"
    return water_error(on.centres, off.centres, DEPTH)


TABLE = Table(
    f"Parts of a scene, off and on: a tank of 3,072 particles, medians of {FRAMES} alternating "
    "frames of 1/60 s, image 640x360",
    ("part",),
    {(part.name,): partial(measured, part) for part in CASES},
    {
        "ms per frame, off": ".1f",
        "on": ".1f",
        "share of the frame": ".0%",
        "additional s at the first start (one run)": ".1f",
        "own kernels, off": ".0f",
        "own kernels, on": ".0f",
        "own launches per frame, off": ".1f",
        "own launches per frame, on": ".1f",
    },
    starts=1,
    environment={"TI_OFFLINE_CACHE": "0"},  # the start includes compiling
)
