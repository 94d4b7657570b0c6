"""Benchmark of one scene: runs it headless and reports speed and errors."""

import math
from contextlib import closing
from dataclasses import dataclass
from typing import Any

import numpy as np

from msph.measure.kernel_density import kernel_density
from msph.measure.snapshot import Snapshot
from msph.measure.timings import Timings, peak_memory, process_age
from msph.scene.schema import Scene
from msph.stage.headless import Headless, HeadlessPlayer
from msph.stage.link import Order
from msph.stage.loaded_scene import LoadedScene, with_input
from msph.stage.loop import run
from msph.stage.process import start_simulations
from msph.stage.recorded_input import Recording
from msph.stage.remote import Remote
from msph.stage.row import Row
from msph.stage.show import SIMULATED, Show

FRAME_TIME = 1.0 / 60.0
SIZE = (640, 360)
STAGES = ("fluid", "surface", "picture")
# Largest number of frames, evenly spread, after which density errors are measured: it bounds the
# time of a benchmark, as a measurement takes up to 0.2 s.
MEASURED_FRAMES = 20


@dataclass(frozen=True)
class Result:
    """One row of the benchmark, for frames of 1/60 s of simulated time, or as recorded.

    Frames per second are means over the run, of the fluid alone and in total; errors are relative
    (-). kernel_density_error and bulk_density_error: means over frames of errors that are measured
    from the positions at their ends (msph/measure), outside the timing; NaN where the water is too
    thin. rest_energy [J]: mean kinetic energy of the last second; rest_speed [m/s]: its
    root-mean-square speed. volume_error: volume of the final surface mesh over the volume at rest
    density, minus 1. profile_ms: mean time [ms] of each stage and part by path, such as
    "fluid/density", or empty.
    """

    scene: str
    particles: list[int]
    frames: int
    frame_p50_ms: float
    frame_p95_ms: float
    stages_p50_ms: dict[str, float]
    fluid_frames_per_second: float
    frames_per_second: float
    simulated_per_wall: float
    steps_per_frame: float
    peak_memory_mib: float
    solver_residual_mean: float
    solver_residual_p99: float
    solver_residual_max: float
    kernel_density_error: float
    bulk_density_error: float
    momentum_drift: float
    energy_gain: float
    rest_energy: float
    rest_speed: float
    volume_error: float
    profile_ms: dict[str, float]

    def row(self) -> dict[str, str]:
        """Returns the cells of a printed table."""
        stages = " / ".join(f"{self.stages_p50_ms[s]:.1f}" for s in STAGES)
        known = math.isfinite(self.bulk_density_error)
        bulk = f"{100 * self.bulk_density_error:.2f}" if known else "unknown"
        return {
            "scene": self.scene,
            "particles": "+".join(map(str, self.particles)),
            "ms p50": f"{self.frame_p50_ms:.1f}",
            "p95": f"{self.frame_p95_ms:.1f}",
            "fluid / surface / image": stages,
            "frames/s": f"{self.frames_per_second:.0f}",
            "real-time factor": f"{self.simulated_per_wall:.2f}",
            "process MiB": f"{self.peak_memory_mib:.0f}",
            "solver residual mean/p99/max %": f"{100 * self.solver_residual_mean:.3f} / "
            f"{100 * self.solver_residual_p99:.2f} / {100 * self.solver_residual_max:.1f}",
            "kernel / bulk density err %": f"{100 * self.kernel_density_error:.2f} / {bulk}",
            "volume err %": f"{100 * self.volume_error:+.1f}",
            "momentum drift %": f"{100 * self.momentum_drift:.2g}",
            "energy gain %": f"{100 * self.energy_gain:.2g}",
        }


class DensityErrors(Headless):
    """Runs frames without input, and measures kernel and bulk density errors (-) after at most
    MEASURED_FRAMES of them."""

    def __init__(self, frames: int):
        super().__init__(frames)
        self.every = math.ceil(frames / MEASURED_FRAMES)
        self.kernel: list[float] = []
        self.bulk: list[float] = []

    def observe(self, row: Row) -> None:
        super().observe(row)
        if self.done % self.every == 0:
            water = Snapshot.of(row.lead.simulation)
            self.kernel.append(kernel_density(water.x, water.spacing, water.size).mean)
            self.bulk.append(abs(row.lead.bulk_density_error()))

    def mean(self, errors: list[float]) -> float:
        """Returns the mean of the errors that are known, NaN if none is."""
        known = [error for error in errors if math.isfinite(error)]
        return sum(known) / len(known) if known else math.nan


def benchmark(
    scene: Scene,
    name: str,
    seconds: float,
    render: bool = True,
    size: tuple[int, int] = SIZE,
    profile: bool = False,
    recording: Recording | None = None,
) -> Result:
    """Runs a scene for `seconds` [s] of simulated time, after a warm-up. Raises BlowUpError.

    Without `render`, the surface is extracted only once at the end, for the volume, and nothing is
    rendered. `profile` slows the run: it synchronizes the device around each part of a step. With
    a recording, its frames are run with its input.
    """
    timings, frame_time = Timings(profile), FRAME_TIME
    how: dict[str, Any] = {"free_steps": True}
    frames = max(1, math.ceil(seconds / frame_time))
    if recording:
        frames, how = recording.moving, SIMULATED
        frame_time = recording.duration / frames
    with closing(
        Show(scene, frame_time, size=size if render else None, timings=timings, **how)
    ) as show:
        show.warm_up()
        errors = DensityErrors(frames)
        run(Row([show]), with_input(errors, recording))
        mean, p99, largest = show.ledger.solver_residual()
        wall = timings.total()
        rest_energy = show.ledger.rest_energy()
        result = Result(
            scene=name,
            particles=show.counts,
            frames=frames,
            frame_p50_ms=1e3 * timings.percentile(50),
            frame_p95_ms=1e3 * timings.percentile(95),
            stages_p50_ms={s: 1e3 * timings.percentile(50, s) for s in STAGES},
            fluid_frames_per_second=frames / timings.total("fluid"),
            frames_per_second=frames / wall,
            simulated_per_wall=frames * frame_time / wall,
            steps_per_frame=show.simulation.steps / frames,
            peak_memory_mib=peak_memory() / 2**20,
            solver_residual_mean=mean,
            solver_residual_p99=p99,
            solver_residual_max=largest,
            kernel_density_error=errors.mean(errors.kernel),
            bulk_density_error=errors.mean(errors.bulk),
            momentum_drift=show.ledger.momentum_drift(),
            energy_gain=show.ledger.energy_gain(),
            rest_energy=rest_energy,
            rest_speed=math.sqrt(2.0 * rest_energy / show.ledger.entries[-1].mass),
            volume_error=show.volume_error(),
            profile_ms={p: 1e3 * t for p, t in timings.tree().items()} if profile else {},
        )
    return result


@dataclass(frozen=True)
class PlayResult:
    """One row of the benchmark of `play`.

    Displayed frames per second of wall-clock time, median and 5th percentile; real-time factor
    simulated_per_wall (-); mean image scale (-); initial number of particles by layer; mean solver
    residual (-); start_seconds [s]: time from the start of the process to the first frame.
    """

    scene: str
    quality: str
    particles: list[int]
    frames_per_second: float
    slowest_frames_per_second: float
    simulated_per_wall: float
    picture_scale: float
    solver_residual_mean: float
    start_seconds: float

    def row(self) -> dict[str, str]:
        """Returns the cells of a printed table."""
        return {
            "scene": self.scene,
            "quality": self.quality,
            "particles": "+".join(map(str, self.particles)),
            "displayed frames/s": f"{self.frames_per_second:.0f}",
            "slowest 5 %": f"{self.slowest_frames_per_second:.0f}",
            "real-time factor": f"{self.simulated_per_wall:.2f}",
            "image scale": f"{self.picture_scale:.2f}",
            "solver residual mean %": f"{100 * self.solver_residual_mean:.3f}",
        }


def benchmark_play(
    loaded: LoadedScene, seconds: float, size: tuple[int, int], arch: str, threads: int | None
) -> PlayResult:
    """Plays a scene for `seconds` [s] of wall-clock time as a window of `size` does; arch, threads:
    of the simulation's process."""
    scene, order = loaded.scene, Order([loaded.scene], whole=True)
    with Remote(*start_simulations(arch, threads)) as remote:
        row = remote.row(order, size)
        ready, lead = process_age(), row.lead
        player = HeadlessPlayer(seconds, scene.play.fps)
        particles = lead.state.counts()
        run(row, player)
        row.close()
    walls = np.array(player.walls)
    return PlayResult(
        scene=loaded.name,
        quality=loaded.quality,
        particles=particles,
        frames_per_second=float(1.0 / np.median(walls)),
        slowest_frames_per_second=float(1.0 / np.percentile(walls, 95)),
        simulated_per_wall=sum(player.simulated) / float(walls.sum()),
        picture_scale=float(np.mean(player.scales)),
        solver_residual_mean=float(np.nanmean(player.residuals)),
        start_seconds=ready,
    )


def profile_lines(profile_ms: dict[str, float]) -> list[str]:
    """Returns the lines of the profile tree: stage, ms per frame, share of the frame."""
    frame = sum(spent for path, spent in profile_ms.items() if "/" not in path)
    lines = []
    for path, spent in profile_ms.items():
        *above, name = path.split("/")
        label = "  " * (1 + len(above)) + name
        lines.append(f"{label:28}{spent:9.2f} ms{100 * spent / frame:7.1f} %")
    return lines
