"""Random input: gestures with all tools, tilts, sliders, pauses and resets in every scene."""

import math
from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np

from bench.tables import Bench, Table
from msph.errors import MsphError
from msph.measure import account
from msph.scene import load_scene
from msph.scene.library import shipped_scenes
from msph.scene.live import live_parameters
from msph.scene.quality import at_quality, single_quality_reason
from msph.scene.schema import Scene
from msph.stage.controls import Inputs, ToolUse
from msph.stage.input_relays import Replayer
from msph.stage.loop import Audience, run
from msph.stage.recorded_input import Header, RecordedFrame, Recording
from msph.stage.row import Row
from msph.stage.show import SIMULATED, Show
from msph.stage.tools import HOVER, TOOLS

# Frame times [s], and the number of frames of a gesture.
FRAME_TIMES, FRAMES = (1.0 / 120.0, 1.0 / 24.0), (1, 12)
# Fastest drag in box lengths per second: half the box in 0.3 s.
FASTEST_DRAG = 0.5 / 0.3
# Time [s] without input before the density is measured, and its frame time [s].
REST, REST_FRAME = 1.0, 1.0 / 60.0
# Limits: relative change of mass, spilt and added water included (rounding of sums); particles
# outside the box; solver residuals at the end (-), with the limits of an accurate run.
ACCURATE = {figure.key: figure.limit for figure in account.FIGURES}
LIMITS = {
    "mass change": 1e-6,
    "outside": 0,
    "solver residual": ACCURATE["solver_residual_mean"],
    "99th percentile": ACCURATE["solver_residual_p99"],
}
# Scenes, number of gestures in all of them, and quality of scenes that have several.
SCENES, INPUTS, QUALITY = tuple(shipped_scenes()), 2000, "small"
# Shares of gestures without a tool; the others use a tool.
KINDS = {"tilt": 0.1, "set": 0.15, "still": 0.05, "reset": 0.005, "wait": 0.05}


class Gestures:
    """Random gestures in a scene, as the input of frames."""

    def __init__(self, scene: Scene, rng: np.random.Generator):
        self.scene, self.rng = scene, rng
        self.size = np.array(scene.box.size)
        self.live = live_parameters(scene)
        self.tilt = np.zeros(2)
        self.azimuth = float(rng.uniform(-math.pi, math.pi))

    def recording(self, name: str, number: int) -> Recording:
        """Returns `number` gestures in the scene `name`, and the time without input after them."""
        inputs = [frame for _ in range(number) for frame in self.gesture()]
        inputs += self.end()
        frames = [RecordedFrame(k, 0.0, each) for k, each in enumerate(inputs)]
        return Recording(Header(1, "", name, ""), frames)

    def gesture(self) -> Iterator[Inputs]:
        """Returns the frames of a gesture."""
        names, shares = list(KINDS), list(KINDS.values())
        kind = str(self.rng.choice(["use", *names], p=[1.0 - sum(shares), *shares]))
        number = int(self.rng.integers(*FRAMES))
        if kind == "use":
            return self.use(number)
        if kind == "tilt":
            return self.turn(number)
        if kind == "set":
            live = self.live[self.rng.integers(len(self.live))]
            value = float(self.rng.uniform(live.lo, live.hi))
            return iter([self.frame(set={live.key: value})])
        if kind == "wait":
            return (self.frame() for _ in range(number))
        return iter([self.frame(**{kind: True})])

    def frame(self, **given: Any) -> Inputs:
        """Returns a frame at the current tilt; some frames end early, as on a slow machine."""
        low, high = FRAME_TIMES
        time = float(self.rng.uniform(low, high))
        until = float(self.rng.uniform(0.0, time)) if self.rng.random() < 0.1 else None
        roll, pitch = self.tilt.tolist()
        return Inputs(time, until, tilt=(roll, pitch), azimuth=self.azimuth, **given)

    def use(self, number: int) -> Iterator[Inputs]:
        """Returns the frames of a drag with a random tool, or of a hovering cursor."""
        rng, longest = self.rng, float(self.size.max())
        tool = (*TOOLS, HOVER)[rng.integers(len(TOOLS) + 1)]
        place = rng.uniform(0.0, 1.0, 3) * self.size
        begin, held = place.copy(), 0.0
        way, down = rng.normal(size=(2, 3))
        down[1] = -abs(down[1])
        way *= FASTEST_DRAG * longest * rng.random() ** 2 / np.linalg.norm(way)
        down /= np.linalg.norm(down)
        for _ in range(number):
            frame = self.frame()
            step = frame.frame_time or 0.0
            held += step
            place = place + step * way
            frame.use = ToolUse.of(tool.name, (place, way, begin, place, down), step, held)
            yield frame

    def turn(self, number: int) -> Iterator[Inputs]:
        """Returns the frames of a tilt at the rate of the arrow keys."""
        limit = math.radians(self.scene.play.tilt_limit)
        rate = math.radians(self.scene.play.tilt_rate)
        way = self.rng.integers(-1, 2, 2)
        for _ in range(number):
            self.tilt = np.clip(self.tilt + REST_FRAME * rate * way, -limit, limit)
            frame = self.frame()
            frame.frame_time, frame.until = REST_FRAME, None
            yield frame

    def end(self) -> Iterator[Inputs]:
        """Returns the frames in which the pool comes level, and the time without input."""
        rate = math.radians(self.scene.play.tilt_rate)
        changes: dict[str, float | None] = {live.key: None for live in self.live}
        while self.tilt.any():
            step = 0.5 * REST_FRAME * rate
            self.tilt -= np.clip(self.tilt, -step, step)
            roll, pitch = self.tilt.tolist()
            yield Inputs(REST_FRAME, tilt=(roll, pitch), azimuth=self.azimuth)
        for _ in range(round(REST / REST_FRAME)):
            yield Inputs(REST_FRAME, set=changes)
            changes = {}


class Watch(Audience):
    """Records the largest change of mass and number of particles outside the box, over resets."""

    def __init__(self) -> None:
        self.mass, self.outside, self.spilt, self.added = 0.0, 0, 0.0, 0.0

    def wants_more(self, row: Row) -> bool:
        return True

    def observe(self, row: Row) -> None:
        ledger = row.lead.ledger
        last = ledger.entries[-1]
        self.mass = max(self.mass, abs(ledger.mass_change()))
        self.outside = max(self.outside, last.outside)
        self.spilt, self.added = max(self.spilt, last.spilt), max(self.added, last.added_mass)
        # Only the first and the last entry are needed.
        del ledger.entries[1:-1]


def run_scene(scene: Scene, name: str, number: int, seed: int) -> dict[str, Any]:
    """Runs a scene with `number` gestures; returns its figures."""
    rng = np.random.default_rng([seed, *name.encode()])
    recording = Gestures(scene, rng).recording(name, number)
    show = Show(scene, REST_FRAME, density_every=math.inf, **SIMULATED)
    row, watch = Row([show]), Watch()
    mean, p99, ended = math.nan, math.nan, "finished"
    try:
        run(row, Replayer(watch, recording))
        show.ledger.density_every = 0.0
        last = show.ledger.record(show.gravity())
        mean, p99 = last.solver_residual_mean, last.solver_residual_p99
    except MsphError as error:
        ended = f"frame {row.lead.frames}: {error}"
    found = {
        "inputs": number,
        "frames": len(recording.frames),
        "simulated [s]": recording.duration,
        "added [kg]": watch.added,
        "spilt [kg]": watch.spilt,
        "mass change": watch.mass,
        "outside": watch.outside,
        "solver residual": mean,
        "99th percentile": p99,
        "ended": ended,
    }
    row.close()
    return found


def problems(found: dict[str, Any]) -> list[str]:
    """Returns the figures that are beyond their limits, and the error of a run that failed."""
    failed = [] if found["ended"] == "finished" else [found["ended"]]
    return failed + [
        f"{key} {found[key]:.2g}" for key, limit in LIMITS.items() if not found[key] <= limit
    ]


def shipped(name: str, seed: int) -> dict[str, Any]:
    """Returns the figures of a shipped scene."""
    scene = load_scene(name)
    if not single_quality_reason(scene):
        scene = at_quality(scene, QUALITY, name)
    found = run_scene(scene, name, math.ceil(INPUTS / len(SCENES)), seed + 1)
    limits = ", ".join(problems(found)) or "kept"
    del found["ended"]
    return {"seed": str(seed + 1), **found, "limits": limits}


BENCHES = {
    "random_input": Bench(
        "Random input",
        f"Gestures with all tools, tilts, sliders, pauses and resets, then {REST:g} s without "
        f"input; quality {QUALITY}.\nMass change: largest of the run, spilt and added water "
        "included. Outside: largest number of particles\noutside the box. Solver residuals: at "
        f"the end. Limits: {', '.join(f'{k} {v:g}' for k, v in LIMITS.items())}.\n",
        {
            "scenes": Table(
                f"{INPUTS:,} gestures per seed in all scenes",
                ("scene",),
                {(name,): partial(shipped, name) for name in SCENES},
                {
                    "inputs": ".0f",
                    "frames": ".0f",
                    "simulated [s]": ".2g",
                    "added [kg]": ".2g",
                    "spilt [kg]": ".2g",
                    "mass change": ".2g",
                    "outside": ".0f",
                    "solver residual": ".2g",
                    "99th percentile": ".2g",
                },
            )
        },
    )
}
