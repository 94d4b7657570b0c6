"""What each optional part of a scene takes while it is on, and whether it takes nothing while off.

A process for each part builds the same water without it and with it, and runs both frame by frame
in turn. `bench/terms.py` prints the table.
"""

import json
import math
import os
import statistics
import subprocess
import sys
import time
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import click
import numpy as np
import taichi as ti

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from bench.tanks import FRAME
from msph.device import ARCHES, start
from msph.fluid.external_forces import ExternalForces
from msph.measure.ledger import Ledger
from msph.measure.probes import build_probes
from msph.measure.snapshot import Snapshot
from msph.scene.build import build_simulation
from msph.scene.parts import PARTS
from msph.scene.schema import Scene
from msph.stage.explain import picture_error, water_error
from msph.stage.show import Show
from msph.taichi_internals import watch_launches

# A tank of 3,072 particles that sloshes under slanted gravity [m, m/s^2].
SIZE, DEPTH, SPACING, GRAVITY = (0.6, 0.4, 0.4), 0.2, 0.025, (1.5, -9.7, 0.0)
# The picture [pixels]; frames that are timed, and those before, in which caches fill.
PICTURE, FRAMES, UNTIMED = (640, 360), 30, 3


@dataclass(frozen=True)
class Case:
    """on, off: changes of the tank's scene, by section, with the part and without it. beside: what
    is run after each frame of the side that has the part: "ledger", "probes", "surface" or
    "picture" (surface and picture); always: what is run on both sides. modules: prefix of the
    modules whose kernels belong to the part, "" where other parts' kernels do its work."""

    name: str
    on: dict[str, Any] = field(default_factory=dict)
    off: dict[str, Any] = field(default_factory=dict)
    beside: str = ""
    always: str = ""
    modules: str = ""


LAYERS = [{"spacing": SPACING * 2.0 ** (k / 3.0)} for k in range(3)]
LAYERED = {"layers": LAYERS, "water": [{"layer": 2}]}
BALL = {"centre": [0.4, 0.1, 0.2], "radius": 0.08}
PROBES = [
    {"name": "floor", "kind": "pressure", "point": [0.3, 0.0, 0.2]},
    {"name": "front", "kind": "front", "axis": "+x"},
]
# Scenes with and without each of the parts, and what is run on both sides.
SCENES: dict[str, tuple[dict[str, Any], dict[str, Any], str]] = {
    "viscosity": ({"projection": {"viscosity": 1.0}}, {}, ""),
    "tension": ({"projection": {"tension": 0.072}}, {}, ""),
    "shear relief": ({"projection": {"shear_relief": 0.9}}, {}, ""),
    "xsph": ({"projection": {"xsph": 0.05}}, {}, ""),
    "adaptation": ({**LAYERED, "adaptation": {"enabled": True}}, LAYERED, ""),
    "bodies": ({"obstacles": [BALL]}, {}, ""),
    "caustics": ({}, {"picture": {"caustics": False}}, "picture"),
    "supersample": ({"picture": {"supersample": 2}}, {}, "picture"),
}
CASES = (
    *(
        Case(part.name, *SCENES[part.name][:2], "", SCENES[part.name][2], part.modules)
        for part in PARTS
    ),
    Case("ledger", beside="ledger", modules="msph.measure"),
    Case("probes", {"probes": PROBES}, beside="probes", modules="msph.measure"),
    Case("surface", beside="surface", modules="msph.surface"),
    Case("picture, surface included", beside="picture", modules="msph.picture"),
    Case("refraction", off={"picture": {"refractive_index": 1.0}}, always="picture"),
)


def scene_with(changes: dict[str, Any]) -> Scene:
    """The tank with changes by section."""
    water = {"layer": 0, "lo": [0, 0, 0], "hi": [SIZE[0], DEPTH, SIZE[2]]}
    tank: dict[str, Any] = {
        "box": {"size": SIZE},
        "gravity": GRAVITY,
        "layers": [{"spacing": SPACING}],
        "water": [water | given for given in changes.get("water", [{}])],
    }
    return Scene.model_validate({**tank, **{k: v for k, v in changes.items() if k != "water"}})


class Side:
    """The tank with a part, or without it.

    start [s]: CPU time of building, compiling and a first frame. kernels: those launched by then,
    as module:Class.kernel. launches: their number in the timed frames, by kernel. times [s]:
    wall-clock time of each timed frame. centres (3,) [m]: centre of mass after each frame."""

    def __init__(self, changes: dict[str, Any], beside: str):
        self.scene, self.beside = scene_with(changes), beside
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
        if self.beside in ("surface", "picture"):
            picture = PICTURE if self.beside == "picture" else None
            self.show = Show(self.scene, FRAME, picture, meshes=True)
            self.sim = self.show.simulation
        else:
            self.sim = build_simulation(self.scene)
        self.sim.warm_up(FRAME)
        if self.beside == "ledger":
            self.ledger = Ledger(self.sim, density_every=math.inf)
        self.probes = build_probes(self.scene) if self.beside == "probes" else []

    def frame(self) -> None:
        """A frame of the water, and what is run beside it."""
        self.sim.advance(FRAME, ExternalForces(gravity=GRAVITY))
        if self.ledger:
            self.ledger.record(GRAVITY)
        if self.probes:
            water = Snapshot.of(self.sim)
            for probe in self.probes:
                probe.read(water)
        if self.show:
            self.show.draw()

    def timed(self) -> None:
        """A frame, its wall-clock time [s], and where the water is after it."""
        ti.sync()
        begin = time.perf_counter()
        with watch_launches(lambda owner, name: self.launches.update([full_name(owner, name)])):
            self.frame()
        ti.sync()
        self.times.append(time.perf_counter() - begin)
        layer = self.sim.particles.numpy("layer")
        mass = np.array([s.mass for s in self.sim.layers.specs])[layer]
        x = self.sim.particles.numpy("x").astype(float)
        self.centres.append((mass[:, None] * x).sum(axis=0) / mass.sum())


def full_name(owner: Any, kernel: str) -> str:
    """module:Class.kernel"""
    return f"{type(owner).__module__}:{type(owner).__name__}.{kernel}"


def measured(part: Case) -> dict[str, Any]:
    """The part's row, in numbers."""
    # The first build pays for what all share, such as Taichi's own library.
    Side({}, "")
    off = Side(part.off, part.always)
    on = Side(part.on, part.beside or part.always)
    for frame in range(UNTIMED + FRAMES):
        for side in (off, on):
            if frame == UNTIMED:
                side.times.clear()
                side.launches.clear()
            side.timed()

    def own(names: Any) -> list[str]:
        return [name for name in names if part.modules and name.startswith(part.modules)]

    return {
        "name": part.name,
        "ms": [statistics.median(side.times) * 1e3 for side in (off, on)],
        "start": [off.start, on.start],
        "kernels": [len(own(side.kernels)) for side in (off, on)],
        "launches": [
            sum(side.launches[name] for name in own(side.launches)) / FRAMES for side in (off, on)
        ],
        "error": error(part, off, on),
    }


def error(part: Case, off: Side, on: Side) -> str:
    """What is wrong without the part."""
    if on.show and off.show:
        return f"picture: {picture_error(on.show, off.show)}"
    if part.beside:
        return "none: it reads the water"
    return water_error(on.centres, off.centres, DEPTH)


def rows(arch: str) -> list[dict[str, str]]:
    """Rows of all parts, each measured in a process of its own, with an empty cache of kernels."""
    found = []
    for part in CASES:
        command = [sys.executable, __file__, "--worker", part.name, "--arch", arch]
        environment = {**os.environ, "TI_OFFLINE_CACHE": "0"}
        done = subprocess.run(command, check=True, capture_output=True, text=True, env=environment)
        found.append(cells(json.loads(done.stdout.splitlines()[-1])))
    return found


def cells(row: dict[str, Any]) -> dict[str, str]:
    """The cells of a printed table; "off, on" where both are of interest."""
    (ms_off, ms_on), (start_off, start_on) = row["ms"], row["start"]
    return {
        "part": row["name"],
        "ms a frame, off": f"{ms_off:.1f}",
        "on": f"{ms_on:.1f}",
        "share of it when on": f"{100.0 * (1.0 - ms_off / ms_on):.0f} %",
        "s more at a first start, one of each": f"{start_on - start_off:.1f}",
        "own kernels: off, on": "{}, {}".format(*row["kernels"]),
        "own launches a frame: off, on": "{:.1f}, {:.1f}".format(*row["launches"]),
        "error without it after .5 s": row["error"],
    }


@click.command()
@click.option("--worker", "name", required=True, type=click.Choice([p.name for p in CASES]))
@click.option("--arch", type=click.Choice(ARCHES), default="auto", show_default=True)
def main(name: str, arch: str) -> None:
    """Prints the row of one part as JSON."""
    start(arch)
    (part,) = (p for p in CASES if p.name == name)
    click.echo(json.dumps(measured(part)))


if __name__ == "__main__":
    main()
