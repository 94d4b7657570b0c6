"""Shipped scenes: errors, cost of each quality, real-time play, changes of the scene, devices."""

import itertools
import json
import math
import os
import subprocess
import sys
import tempfile
import time
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import taichi as ti

from bench.tables import Bench, Table, forms
from bench.tanks import FRAME, milliseconds
from msph.constants import DEFAULT_SCENE
from msph.device import start
from msph.errors import BlowUpError
from msph.launches import watch_compiling
from msph.measure.timings import Timings, peak_memory
from msph.options import QUALITIES
from msph.scene import load_scene
from msph.scene.library import assets, shipped_scenes
from msph.scene.quality import AS_GIVEN, LADDER, Quality, at_quality, scaled, single_quality_reason
from msph.scene.water import layer_specs
from msph.stage.controls import Controls
from msph.stage.row import Row
from msph.stage.show import INTERACTIVE, Show

# Simulated time of a scene of the table of errors [s].
SECONDS = 2.0
# Elapsed time of a played scene [s], and its quality.
PLAYED, PLAYED_QUALITY = 8.0, "auto"
# Quality of the reference run, simulated time of a run and length of its slowest part [s].
REFERENCE, RUN, WINDOW = Quality(2.0 ** (-2.0 / 3.0), 0.01), 4.0, 0.5
# Image size of a scene that is visited [pixels]: the default of the window.
SIZE = (960, 540)
# Comparison of devices: simulated time [s], and quality of scenes that have several.
COMPARED, COMPARED_QUALITY = 0.2, "small"
SCENES = tuple(shipped_scenes())


def command(*words: str, cache: str = "") -> None:
    """Runs an msph command; cache: folder of the kernel cache. Raises CalledProcessError."""
    more = {"TI_OFFLINE_CACHE_FILE_PATH": cache} if cache else {}
    whole = [sys.executable, "-m", "msph", *words]
    subprocess.run(whole, check=True, capture_output=True, env={**os.environ, **more})


def errors(scene: str, seed: int) -> dict[str, float]:
    """Returns the figures of `msph measure` for a scene, and the speed-up of its layers."""
    with tempfile.TemporaryDirectory() as folder:
        options = ["--arch", start(), "--seconds", str(SECONDS), "--set", f"seed={seed}"]
        command("measure", scene, "-o", folder, *options)
        found = json.loads((Path(folder) / "summary.json").read_text())
    found |= {"count": sum(found["particles_end"]), **found["errors"], **gain(scene)}
    known = {name: found.get(key) for name, (_, key) in ERRORS.items()}
    return {name: value for name, value in known.items() if value is not None}


# Figures of `msph measure`, and the speed-ups: format and key.
ERRORS = {
    "particles at the end": (",.0f", "count"),
    "ms per frame": (".1f", "frame_ms_p50"),
    "first quartile": (".1f", "frame_ms_p25"),
    "third quartile": (".1f", "frame_ms_p75"),
    "real-time factor": (".2f", "simulated_per_wall"),
    "speed-up over uniform": (".2f", "faster"),
    "over particles": (".2f", "over_particles"),
    "bulk density error, mean": ("+.2%", "bulk_density_error_mean"),
    "worst": ("+.2%", "bulk_density_error_worst"),
    "at the end": ("+.2%", "bulk_density_error_last"),
    "volume error, mean": ("+.2%", "volume_error_mean"),
    "energy rise in 1 s": ("+.2%", "energy_rise_in_1_s"),
    "kernel density error, mean": ("+.2%", "kernel_density_error_mean"),
    "99th percentile of it": ("+.2%", "kernel_density_error_p99"),
    "solver residual, mean": ("+.2%", "solver_residual_mean"),
    "99th percentile": ("+.2%", "solver_residual_p99"),
    "largest": ("+.2%", "solver_residual_max"),
    "mass change": (".0e", "mass_change"),
    "outside": (".0f", "outside_most"),
}
# Figures of `msph bench --play`: format and key.
PLAY = {
    "particles": (",.0f", "count"),
    "displayed frames/s": (".0f", "frames_per_second"),
    "slowest 5 %": (".0f", "slowest_frames_per_second"),
    "real-time factor": (".2f", "simulated_per_wall"),
    "image scale": (".2f", "picture_scale"),
    "solver residual, mean": (".3%", "solver_residual_mean"),
}


def gain(name: str) -> dict[str, float]:
    """Returns the speed-up of an adaptive scene over uniform water of its finest size, in
    alternating frames, and the speed-up over the mean ratio of the numbers of particles."""
    scene = load_scene(name)
    if not scene.adaptation.enabled:
        return {}
    finest = min(spec.mass for spec in layer_specs(scene))
    layers = [f"water.{k}.layer=0" for k in range(len(scene.water))]
    uniform = (f"layers=[{{ mass = {finest} }}]", "adaptation.enabled=false", *layers)
    # Without solver residuals, which need an additional neighbour search.
    shows = [
        Show(load_scene(name, given), FRAME, density_every=math.inf) for given in ((), uniform)
    ]
    for show in shows:
        show.warm_up()
    times, counts = np.zeros(2), np.zeros(2)
    for _ in range(round(SECONDS / FRAME)):
        for k, show in enumerate(shows):
            times[k] += milliseconds(partial(show.frame, Controls()))
            counts[k] += sum(show.simulation.counts())
    faster = times[1] / times[0]
    return {"faster": faster, "over_particles": faster * counts[0] / counts[1]}


def played(scene: str, seconds: float, quality: str, cache: str = "") -> dict[str, Any]:
    """Returns the row of `msph bench --play` for a scene; cache: folder of the kernel cache."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "row.json"
        options = ["--arch", start(), "--seconds", str(seconds), "--quality", quality]
        command("bench", scene, "--play", *options, "--json", str(file), cache=cache)
        return json.loads(file.read_text())[0]


def play(scene: str, seed: int) -> dict[str, Any]:
    """Returns the figures of a scene that is played in real time."""
    played(scene, 0.1, PLAYED_QUALITY)  # fills the kernel cache
    found = played(scene, PLAYED, PLAYED_QUALITY)
    found["count"] = sum(found["particles"])
    return {"quality": found["quality"], **{name: found[key] for name, (_, key) in PLAY.items()}}


def starts(seed: int) -> dict[str, float]:
    """Returns elapsed times [s] of `msph --help`, and from the start of the process until the
    default scene is ready for its first frame."""
    begin = time.perf_counter()
    command("--help")
    told = time.perf_counter() - begin
    with tempfile.TemporaryDirectory() as cache:
        cold, warm = (played(DEFAULT_SCENE, 0.1, "large", cache) for _ in range(2))
    return {
        "`msph --help`, s": told,
        "empty kernel cache, s": cold["start_seconds"],
        "full kernel cache, s": warm["start_seconds"],
    }


def run(name: str, quality: Quality) -> dict[str, Any]:
    """Runs a scene; returns centres of mass (frames, 3) [m], energies [J], CPU and elapsed time of
    each frame [s], the largest number of particles, the depth of the water at rest [m] and its
    weight [N]."""
    scene = scaled(load_scene(name), quality)
    show = Show(scene, FRAME, timings=Timings(), density_every=math.inf)
    show.warm_up()
    cpu, counts = [], []
    for _ in range(round(RUN / FRAME)):
        begin = time.process_time()
        show.frame(Controls())
        cpu.append(time.process_time() - begin)
        counts.append(show.simulation.particles.count)
    entries, (length, _, width) = show.ledger.entries, scene.box.size
    walls = [frame["fluid"] for frame in show.timings.frames]
    show.close()
    return {
        "centre": np.array([e.centre for e in entries]),
        "energy": [e.energy for e in entries],
        "cpu": cpu,
        "wall": walls,
        "particles": max(counts),
        "height": entries[0].mass / (scene.density * length * width),
        "weight": entries[0].mass * float(np.linalg.norm(scene.gravity)),
    }


def judged(found: dict[str, Any], reference: dict[str, Any]) -> dict[str, float]:
    """Returns cost and error of a run: number of particles; CPU and elapsed seconds per simulated
    second, means and in the slowest half second; error against the reference (-); energy lost by
    the end over weight times depth (-)."""
    away = found["centre"] - reference["centre"]
    window = np.ones(round(WINDOW / FRAME)) / WINDOW
    energy = found["energy"]
    return {
        "particles": found["particles"],
        "cpu": sum(found["cpu"]) / RUN,
        "wall": sum(found["wall"]) / RUN,
        "slowest": float(np.convolve(found["wall"], window, "valid").max()),
        "error": float(np.sqrt((away**2).sum(axis=1).mean())) / found["height"],
        "energy_lost": (energy[0] - energy[-1]) / (found["weight"] * found["height"]),
    }


def qualities(name: str, seed: int) -> list[dict[str, Any]]:
    """Returns a row for each quality of a scene."""
    reference = run(name, REFERENCE)
    return [{"quality": q, **judged(run(name, given), reference)} for q, given in LADDER.items()]


def keep(known: list[dict]) -> list[str]:
    """Writes the costs that `msph scenes` prints."""
    costs: dict[str, dict[str, dict[str, float]]] = {}
    for row in known:
        figures = {name: float(f"{float(row[name]):.3g}") for name in COST_FORMS if name in row}
        costs.setdefault(row["case"], {})[row["quality"]] = figures
    (assets() / "quality.json").write_text(json.dumps(costs, indent=1) + "\n")
    return []


def visits(names: tuple[str, ...], seed: int) -> list[dict[str, Any]]:
    """Returns a row for each scene and quality of `names` (AS_GIVEN or QUALITIES): elapsed time
    until the first frame is simulated and rendered [s] after the scene before, and the number of
    kernels compiled for it, on the first visit and on a later one, all in one process."""
    found: dict[tuple[str, str], dict[str, Any]] = {}
    row: Row | None = None
    for visit in ("first visit", "later"):
        for name, quality in itertools.product(SCENES, names):
            compiled: list[str] = []
            begin = time.perf_counter()
            with watch_compiling(compiled.append):
                if row:
                    row.close()
                scene = at_quality(load_scene(name), quality, name)
                row = Row([Show(scene, 1.0 / scene.play.fps, SIZE, **INTERACTIVE)])
                row.frame(Controls())
                ti.sync()
            own = found.setdefault((name, quality), {"scene": name, "quality": quality})
            own[f"{visit}, s"] = time.perf_counter() - begin
            own[f"kernels, {visit}"] = len(compiled)
            own["process MiB"] = peak_memory() / 2**20
    return list(found.values())


def facts(seed: int) -> list[dict[str, Any]]:
    """Returns a row for each scene: number of particles, mean solver residual (-) and kinetic
    energy [J] after COMPARED [s], or a failure."""
    found = []
    for name in SCENES:
        scene = load_scene(name, (f"seed={seed}",))
        quality = AS_GIVEN if single_quality_reason(scene) else COMPARED_QUALITY
        try:
            show = Show(at_quality(scene, quality, name), FRAME)
            for _ in range(round(COMPARED / FRAME)):
                show.frame(Controls())
            last = show.ledger.entries[-1]
            figures: dict[str, Any] = {
                "particles": show.simulation.particles.count,
                "solver residual": last.solver_residual_mean,
                "kinetic energy, J": last.kinetic,
            }
            show.close()
        # Taichi raises RuntimeError for code that a driver rejects.
        except (BlowUpError, RuntimeError) as error:
            figures = {"failure": str(error)[:100]}
        found.append({"scene": name, **figures})
    return found


COST_FORMS = {
    "particles": ",.0f",
    "cpu": ".3g",
    "wall": ".3g",
    "slowest": ".3g",
    "error": ".2%",
    "energy_lost": ".2%",
}
COSTS = (
    "cpu, wall: CPU time of all threads, and elapsed time, per simulated second [s/s]; slowest: "
    "elapsed time in the slowest half second;\nerror: distance of the centre of mass from a run "
    "with spacings 0.63 times the scene's, rms over the run, over the depth;\nenergy_lost: by the "
    "end, over weight times depth.\n"
)
VISIT_FORMS = {
    "first visit, s": ".2f",
    "kernels, first visit": ".0f",
    "later, s": ".2f",
    "kernels, later": ".0f",
    "process MiB": ",.0f",
}
BENCHES = {
    "scenes": Bench(
        "The shipped scenes",
        "Energy rise: without input, over M g H. A dash: the water is too shallow to measure it. "
        "Uniform water: all particles\nhave the size of the finest layer; both run in alternating "
        "frames; over particles: speed-up over the mean ratio of\nthe numbers of particles.\n",
        {
            "errors": Table(
                f"{SECONDS:g} s of each scene",
                ("scene",),
                {(name,): partial(errors, name) for name in SCENES},
                forms(ERRORS),
                starts=1,
            )
        },
    ),
    "play": Bench(
        "Playing the shipped scenes",
        "",
        {
            "starts": Table(
                f"Elapsed time of the start of `{DEFAULT_SCENE}`, until its first frame",
                (),
                {(): starts},
                {
                    "`msph --help`, s": ".2f",
                    "empty kernel cache, s": ".1f",
                    "full kernel cache, s": ".1f",
                },
            ),
            "play": Table(
                f"{PLAYED:g} s of elapsed time each, image 960x540, quality {PLAYED_QUALITY}",
                ("scene",),
                {(name,): partial(play, name) for name in SCENES},
                forms(PLAY),
                starts=1,
            ),
        },
    ),
    "quality": Bench(
        "Qualities of the shipped scenes",
        COSTS,
        {
            "quality": Table(
                f"{RUN:g} s of each scene",
                ("scene",),
                {(name,): partial(qualities, name) for name in SCENES},
                COST_FORMS,
                starts=1,
            )
        },
        keep,
    ),
    "visits": Bench(
        "Changing the scene in one process",
        "Elapsed time from the selection of a scene to its first image, and kernels compiled for "
        "it.\n",
        {
            "given": Table(
                "Every scene at its own quality",
                (),
                {(): partial(visits, (AS_GIVEN,))},
                VISIT_FORMS,
                starts=1,
            ),
            "every": Table(
                "Every scene at every quality",
                (),
                {(): partial(visits, QUALITIES)},
                VISIT_FORMS,
                starts=1,
            ),
        },
    ),
    "vulkan": Bench(
        "The shipped scenes on other devices and on the CPU",
        f"{COMPARED:g} s of each at quality {COMPARED_QUALITY} (large for scenes with a single "
        "quality), from the same particles; on the\nCPU medians and ranges of random initial "
        "positions, the first of which the other devices run.\n",
        {
            arch: Table(
                f"On {arch}",
                (),
                {(): facts},
                {"particles": ",.0f", "solver residual": ".4%", "kinetic energy, J": ".4g"},
                starts=3 if arch == "cpu" else 1,
                arch=arch,
            )
            for arch in ("cpu", "vulkan", "cuda")
        },
    ),
}
