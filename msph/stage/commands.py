"""What each command does, once its options are known."""

import json
import math
import sys
from pathlib import Path

import click
from tabulate import tabulate

from msph.device import restart, start
from msph.errors import BlowUpError, LostOutputError
from msph.fluid.trapped_water import TrappedWaterError
from msph.measure import convergence, table
from msph.measure.machine_speed import machine_speed
from msph.measure.past import time_of
from msph.measure.plots import plot
from msph.measure.timings import Timings
from msph.own_files import guard, replace, sealed
from msph.scene import load_scene
from msph.scene.library import find_scene, shipped_scenes
from msph.scene.load import read_toml, to_toml
from msph.scene.parameters import parameters
from msph.scene.quality import AS_GIVEN, AUTO, at_quality, choose, coarser, costs
from msph.scene.schema import Scene
from msph.scene.water import layer_specs
from msph.stage.benchmark import Played, Result, benchmark, play_benchmark, profile_lines
from msph.stage.choice import Called, Choice
from msph.stage.explain import explain
from msph.stage.loop import run
from msph.stage.measurer import CHECKPOINT, FILES, LEDGER, PROBES, SCENE, Measurer
from msph.stage.player import Player
from msph.stage.preparation import prepare, prepare_row, say
from msph.stage.recorder import NUMBER, Outputs, Recorder, check_outputs, make_writable
from msph.stage.remote_window import RemoteWindow

# What `play` leaves behind where it cannot open a window.
FALLBACK_SECONDS = 10.0
FALLBACK_FPS = 30.0
FALLBACK_SIZE = (1280, 720)
STILL_TIME = 1.0
# Sizes of a benchmark's picture [pixels]: its own, and that of the window it stands for.
BENCH_SIZE, PLAY_SIZE = (640, 360), (960, 540)
# What comparing spacings writes.
CONVERGENCE = "convergence.csv"
# Exit code of a benchmark in which some water blew up.
BAD_RUN = 1


def play_choice(window: RemoteWindow, choice: Choice, called: Called, arch: str) -> None:
    """Plays a choice until its window is closed, or shows another water."""
    waters, quality = called.waters_of(choice.scene), choice.quality
    if len(waters) > 1 and quality == AUTO:
        # What one water may cost says nothing of several, and they are to be compared as written.
        quality = AS_GIVEN
    window.tell(0.0, "measuring this machine")
    first, *others = waters.values()
    at_step, quality = at(first, choice.scene, quality, arch, window.display)
    scenes = [at_step, *(at_quality(other, quality, choice.scene) for other in others)]
    show = prepare_row(scenes, list(waters), window.size, window.tell)
    player = Player(window, show, choice, quality, called.frames, window.ask, called.waters_of)
    run(show, player)
    for warning in show.warnings():
        say(f"warning: {warning}")


def capture_instead(called: Called, quality: str, reason: str) -> None:
    """Ten seconds of a scene, where no window can be opened, and a picture of it."""
    scene = called.scene
    loaded = load_scene(scene, called.overrides)
    if called.beside:
        say("--beside needs a window: the first water is captured")
    target = Path("out") / Path(scene).stem
    say(f"{reason}: capturing {FALLBACK_SECONDS:.0f} s of {scene} instead")
    outputs = Outputs([target.with_suffix(".mp4"), target.with_suffix(".png")])
    check_outputs(outputs, FALLBACK_FPS)
    guard(scene_beside(outputs), outputs.existing(), force=False)
    # A window may have been tried.
    restart(called.arch, called.threads)
    # A capture need not keep up with the clock.
    loaded, quality = at(loaded, scene, AS_GIVEN if quality == AUTO else quality)
    record(loaded, quality, outputs, FALLBACK_SECONDS, FALLBACK_FPS, FALLBACK_SIZE, STILL_TIME)


def capture(
    scene,
    outputs,
    meshes,
    particles,
    resume,
    seconds,
    fps,
    size,
    force,
    overrides,
    arch,
    threads,
    quality,
) -> None:
    """Records a scene into files."""
    loaded = load_scene(scene, overrides)
    some = outputs or meshes or particles
    kinds = list(outputs or () if some else [Path("out") / f"{Path(scene).stem}.mp4"])
    files = Outputs(kinds, list(meshes), list(particles))
    check_outputs(files, fps)
    guard(scene_beside(files), files.existing(), force)
    arch = start(arch, threads)
    loaded, quality = at(loaded, scene, quality, arch)
    record(loaded, quality, files, seconds or loaded.duration, fps, size, resume=resume)


def bench(
    scenes,
    seconds,
    no_render,
    as_played,
    size,
    profile,
    json_file,
    overrides,
    arch,
    threads,
    quality,
) -> None:
    """Times scenes and prints a row for each."""
    names = scenes or tuple(shipped_scenes())
    if json_file:
        make_writable(json_file)
    given = [(name, load_scene(name, overrides)) for name in names]
    arch = start(arch, threads)
    loaded = [(name, *at(scene, name, quality, arch)) for name, scene in given]
    rows: list[Result | Played] = []
    failed = False
    for name, scene, step in loaded:
        say(f"{name}: compiling kernels, then running")
        try:
            duration = seconds or scene.duration
            if as_played:
                rows.append(play_benchmark(scene, name, step, duration, size or PLAY_SIZE))
            else:
                rows.append(
                    benchmark(scene, name, duration, not no_render, size or BENCH_SIZE, profile)
                )
        except (BlowUpError, TrappedWaterError) as error:
            say(f"{name}: FAILED: {error}")
            failed = True
    if rows:
        timed = "frames of 1/60 s, milliseconds per frame, medians by stage"
        click.echo(f"arch {arch}, {'played by the wall clock' if as_played else timed}")
        click.echo(tabulate([r.row() for r in rows], headers="keys", tablefmt="github"))
    profiled = [r for r in rows if isinstance(r, Result) and r.profile_ms]
    if profiled:
        click.echo("\nprofiled, which slows the run: so are the figures above; means per frame")
    for row in profiled:
        click.echo("\n".join([row.scene, *profile_lines(row.profile_ms)]))
    if json_file:
        replace(json_file, json.dumps([r.as_dict() for r in rows], indent=2) + "\n")
    if failed:
        sys.exit(BAD_RUN)


def measure(
    scene, folder, seconds, every, converge, resume, force, overrides, arch, threads, quality
) -> None:
    """Writes a scene's ledger, probes, summary and plots into a folder, and prints how wrong it
    is."""
    if converge and resume:
        raise click.UsageError("--converge and --resume exclude each other")
    since = time_of(Path(resume)) if resume else None
    given = {"duration": seconds, "measure.every": every}
    options = [f"{key}={value}" for key, value in given.items() if value is not None]
    loaded = load_scene(scene, (*overrides, *options))
    folder = folder or Path("out") / Path(scene).stem
    make_writable(folder / SCENE)
    guard(folder / SCENE, (folder / name for name in FILES), force)
    arch = start(arch, threads)
    loaded, quality = at(loaded, scene, quality, arch)
    if converge:
        measure_convergence(loaded, scene, folder, converge, quality, arch, force)
    else:
        run_of = measured(loaded, scene, folder, quality, arch, resume, since)
        click.echo(f"\n{run_of.account()}")


def measured(
    scene: Scene,
    name: str,
    folder: Path,
    quality: str,
    arch: str,
    resume: str | None = None,
    since: float | None = None,
) -> Measurer:
    """Measures one run of a scene, called `name`, into a folder, from its start or from a
    checkpoint `resume` of the time `since` [s], and names the files that there are."""
    make_writable(folder / SCENE)
    show = None
    if resume:
        # First of all, since a checkpoint of another scene must not cost what the folder holds.
        show = prepare(scene, scene.measure.every, timings=Timings())
        show.resume(Path(resume))
    measurer = Measurer(folder, scene, name, arch, since=since)
    replace(folder / SCENE, sealed(to_toml(scene, f"quality {quality}")))
    try:
        run(show or prepare(scene, scene.measure.every, timings=Timings()), measurer)
    except (Exception, KeyboardInterrupt) as error:
        try:
            measurer.conclude(str(error) or "interrupted")
        except LostOutputError as lost:
            say(str(lost))
        say(f"{folder} holds what was measured until then")
        if (folder / CHECKPOINT).exists():
            say(f"--resume {folder / CHECKPOINT} goes on")
        raise
    paths = measurer.conclude()
    paths += plot(folder, f"{scene.title or name}, quality {quality}")
    for path in paths:
        click.echo(path)
    return measurer


def measure_convergence(
    scene: Scene, name: str, folder: Path, runs: int, quality: str, arch: str, force: bool
) -> None:
    """Measures a scene at several spacings, the scene's own last, each in a folder within, and
    estimates the discretisation error. Raises SceneError where spacings cannot change,
    ForeignFileError where files that no run wrote would be lost, unless by `force`."""
    sequence = coarser(scene, convergence.factors(runs), name)
    folders, spacings = [], []
    for factor, coarse in sequence:
        folders.append(folder if factor == 1.0 else folder / f"spacings_x{factor:.2f}")
        guard(folders[-1] / SCENE, (folders[-1] / name for name in FILES), force)
        spacings.append(min(s.spacing for s in layer_specs(coarse)))
        say(f"{name}: finest spacing {1e3 * spacings[-1]:.4g} mm, run {len(folders)} of {runs}")
        finest = measured(coarse, name, folders[-1], f"{quality}, spacings x{factor:.2f}", arch)
    ledgers, probes = ([table.read(f / file) for f in folders] for file in (LEDGER, PROBES))
    rows = convergence.compare(ledgers, probes, spacings[-1])
    convergence.write(folder / CONVERGENCE, rows, spacings)
    finest.add("discretisation", convergence.as_json(rows))
    click.echo(folder / CONVERGENCE)
    click.echo(f"\n{finest.account()}")
    click.echo(f"\nDiscretisation error of {name}\n{convergence.text(rows, spacings)}")


def scenes(name, list_parameters, explained, overrides, arch, threads, quality) -> None:
    """Lists scenes or parameters, prints one scene, or what its parts cost."""
    if explained:
        if not name:
            raise click.UsageError("--explain needs the NAME of a scene")
        loaded = load_scene(name, overrides)
        arch = start(arch, threads)
        loaded, _ = at(loaded, name, quality, arch)
        click.echo(explain(loaded))
        return
    if overrides or threads or (arch, quality) != ("auto", AS_GIVEN):
        raise click.UsageError("--set, --arch, --threads and --quality go with --explain")
    if list_parameters:
        rows = [p.row() for p in parameters(Scene)]
        click.echo(tabulate(rows, headers="keys", tablefmt="simple"))
    elif name:
        path = find_scene(name)
        read_toml(path)
        click.echo(path.read_text(encoding="utf-8").rstrip())
        for line in ladder_lines(name):
            click.echo(f"# {line}")
    else:
        lines = []
        for key, path in shipped_scenes().items():
            data = read_toml(path)
            title = data.get("title", "")
            if "variants" in data:
                title += f" (--set variant={'|'.join(data['variants'])})"
            lines.append((key, title))
        click.echo(tabulate(lines, tablefmt="plain"))


def ladder_lines(name: str) -> list[str]:
    """What each quality of a shipped scene costs, and its error, a line each."""
    heads = ["--quality", "particles", "wall s per s, dearest", "error % of depth"]
    rows = [
        [quality, cost.particles, f"{cost.dearest:.2f}", f"{100.0 * cost.error:.2f}"]
        for quality, cost in costs(name).items()
    ]
    return tabulate(rows, headers=heads, tablefmt="plain").splitlines() if rows else []


def at(
    scene: Scene, name: str, quality: str, arch: str = "", display: float = 0.0
) -> tuple[Scene, str]:
    """The scene of that name at a quality, and which it is; for AUTO, Taichi must run on arch.
    display [s]: processor time that a picture takes to be shown."""
    if quality == AUTO:
        quality = choose(scene, name, machine_speed(arch), display)
        say(f"{name}: quality {quality}, chosen for this machine")
    return at_quality(scene, quality, name), quality


def record(
    scene: Scene,
    quality: str,
    outputs: Outputs,
    seconds: float,
    fps: float,
    size: tuple[int, int],
    still_time: float | None = None,
    resume: str | None = None,
) -> None:
    """Runs a scene for the recorder; an interrupt ends the recording, not the files. quality: what
    the scene is at."""
    seen, meshes = size if outputs.pictures else None, bool(outputs.meshes)
    beside = scene_beside(outputs)
    show = prepare(scene, 1.0 / fps, seen, meshes=meshes, density_every=math.inf)
    if resume:
        show.resume(Path(resume))
    still = None if still_time is None else max(1, round(still_time * fps))
    frames, first = max(1, round(seconds * fps)), round(show.simulation.time * fps)
    recorder = Recorder(outputs, frames, fps, still, first=first)
    replace(beside, sealed(to_toml(scene, f"quality {quality}")))
    try:
        run(show, recorder)
    except KeyboardInterrupt:
        say(f"stopped after {recorder.done} frames")
        raise
    finally:
        for warning in show.warnings():
            say(f"warning: {warning}")
        for path in [*recorder.kept(), beside]:
            click.echo(path)


def scene_beside(outputs: Outputs) -> Path:
    """Where a recording's scene is written: beside the first output, named like it."""
    first = outputs.all()[0]
    stem = NUMBER.sub("", first.stem).rstrip("_-") or "capture"
    return first.with_name(stem + ".scene.toml")
