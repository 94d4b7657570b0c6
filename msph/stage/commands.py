"""The commands `capture`, `bench` and `scenes`."""

import contextlib
import math
import sys
from dataclasses import asdict
from dataclasses import replace as replace_fields
from pathlib import Path

import click
from tabulate import tabulate

from msph.device import start
from msph.errors import BlowUpError
from msph.export.outputs import NUMBER, Outputs, check_files, check_outputs
from msph.fluid.boundary.rim import AllSpiltError
from msph.fluid.trapped_water import TrappedWaterError
from msph.measure.past import CheckpointError, time_of
from msph.options import (
    AS_GIVEN,
    AUTO,
    BenchOptions,
    CaptureOptions,
    PlayOptions,
    RunOptions,
)
from msph.own_files import SCENE_SUFFIX, OutputError, claim, free_stem, replace, write_json
from msph.scene import load_scene
from msph.scene.bodies import names
from msph.scene.library import find_scene, shipped_scenes
from msph.scene.load import read_toml
from msph.scene.parameters import parameters
from msph.scene.quality import costs
from msph.scene.schema import Scene
from msph.stage.benchmark import SIZE as BENCH_SIZE
from msph.stage.benchmark import PlayResult, Result, benchmark, benchmark_play, profile_lines
from msph.stage.explain import explain
from msph.stage.link import Files, Order
from msph.stage.loaded_scene import LoadedScene, at, exclude, options_of, smooth
from msph.stage.loop import run as run_loop
from msph.stage.preparation import prepare_row, say
from msph.stage.process import Started
from msph.stage.recorded_input import Header, Recording, with_recording
from msph.stage.recorder import ROUNDING, Recorder
from msph.stage.remote import Remote
from msph.stage.simulating import with_files
from msph.stage.trial import SIZE as PLAY_SIZE

# Capture by `play` if no window can be opened: duration [s], frames per second, size [pixels] and
# time of the still image [s].
FALLBACK_SECONDS, FALLBACK_FPS, FALLBACK_SIZE, STILL_TIME = 10.0, 30.0, (1280, 720), 1.0
# Printed after a capture by `play`.
NEXT = (
    "try next: msph scenes; msph capture drop -o drop.webp; msph lesson; "
    "in Python: import msph (docs/python.md)"
)
# Largest number of frames of a recording: six digits in file names.
MAX_FRAMES = 1_000_000
# Exit code of a benchmark with an unstable simulation.
BAD_RUN = 1


def capture_instead(
    scene: str, options: PlayOptions, run: RunOptions, reason: str, process: Started | None
) -> None:
    """Captures a video and an image of a scene if no window can be opened for `reason`; process:
    see record()."""
    if options.beside:
        say("--beside needs a window: only the first simulation is captured")
    seconds = None if options.replay else FALLBACK_SECONDS
    what = f"{seconds:.0f} s of {scene}" if seconds else f"{options.replay}"
    say(f"{reason}: capturing {what} instead")
    # A capture need not run in real time.
    run = replace_fields(run, quality=AS_GIVEN) if run.quality == AUTO else run
    video = default_output(scene, ".mp4")
    files = video, video.with_suffix(".png")
    instead = CaptureOptions(
        *(FALLBACK_FPS, FALLBACK_SIZE, seconds, files),
        still_time=STILL_TIME,
        smooth=False,  # as in a window: four rays per pixel take twice as long
        record_input=options.record_input,
        replay=options.replay,
    )
    capture(None if options.replay else scene, instead, run, process)
    if not options.replay:
        say(NEXT)


def capture(
    scene: str | None, options: CaptureOptions, run: RunOptions, process: Started | None
) -> None:
    """Records a scene to files; process: see record()."""
    scene, run, recording = with_recording(scene, run, options.replay)
    exclude("--replay", recording, "--resume", options.resume)
    loaded = load_scene(scene, run.overrides)
    if options.smooth:
        loaded = smooth(loaded)
    video = ".webm" if loaded.picture.alpha else ".mp4"
    some = options.outputs or options.data
    pictures = options.outputs if some else [default_output(scene, video)]
    if options.mesh_layer and not (options.meshes or options.usd):
        raise click.UsageError("--mesh-layer needs --mesh or --usd")
    kinds = "meshes", "particles", "bodies", "droplets", "usd"
    data = {kind: list(getattr(options, kind)) for kind in kinds}
    files = Outputs(list(pictures), **data, mesh_layer=options.mesh_layer)
    check_outputs(files, options.fps, loaded.picture.alpha, bool(recording or names(loaded)))
    since = time_of(Path(options.resume)) if options.resume else 0.0
    first, seconds = round(since * options.fps), options.seconds or loaded.duration
    total = round(seconds * options.fps)
    if recording:
        recording = recording.cut(options.seconds)
        seconds = min(recording.duration, options.seconds or math.inf)
        # All recorded frames run, also those after the last image that is due.
        total = math.ceil(seconds * options.fps - ROUNDING)
    frames = max(1, total) - first
    if frames <= 0:
        raise CheckpointError.beyond(since, seconds)
    if frames > MAX_FRAMES:
        raise OutputError(
            f"{files.all()[0]}: would have {frames:,} frames; at most {MAX_FRAMES:,} are allowed"
        )
    paths, inputs = files.names(first, frames), inputs_of(scene, options)
    check_files(paths, inputs)
    # Until it is written, only the first frame of a sequence has a file.
    claim(files.names(first, 1), options.force, later=paths)
    record(at(loaded, scene, run), files, options, recording, first, frames, process)


def bench(scenes: tuple[str, ...], options: BenchOptions, run: RunOptions) -> None:
    """Benchmarks scenes and prints a table with a row for each scene."""
    recording = None
    if options.replay:
        exclude("--replay", True, "--play", options.as_played)
        name, run, recording = with_recording(" ".join(scenes), run, options.replay)
        scenes = (name,)
    exclude("--play", options.as_played, "--no-render", options.no_render)
    exclude("--play", options.as_played, "--profile", options.profile)
    names = scenes or tuple(shipped_scenes())
    if options.json_file:
        claim([options.json_file], options.force)
    given = [(name, load_scene(name, run.overrides)) for name in names]
    arch = start(run.arch, run.threads)
    rows, failed = list[Result | PlayResult](), False
    for loaded in [at(scene, name, run) for name, scene in given]:
        if recording:
            recording = recording.cut(options.seconds)
            recording.check(loaded.scene)
        say(f"{loaded.name}: compiling kernels, then running")
        try:
            seconds = options.seconds or loaded.scene.duration
            if options.as_played:
                size = options.size or PLAY_SIZE
                rows.append(benchmark_play(loaded, seconds, size, run.arch, run.threads))
            else:
                parts = not options.no_render, options.size or BENCH_SIZE, options.profile
                rows.append(benchmark(loaded.scene, loaded.name, seconds, *parts, recording))
        except (AllSpiltError, BlowUpError, TrappedWaterError) as error:
            say(f"{loaded.name}: FAILED: {error}")
            failed = True
    if rows:
        how = "frames as recorded" if recording else "frames of 1/60 s"
        how += ", times in ms per frame, medians by stage"
        click.echo(f"arch {arch}, {'played in wall-clock time' if options.as_played else how}")
        click.echo(tabulate([r.row() for r in rows], headers="keys", tablefmt="github"))
    profiled = [r for r in rows if isinstance(r, Result) and r.profile_ms]
    if profiled:
        click.echo("\nmeans per frame; profiling slows the run and increases all times above")
    for row in profiled:
        click.echo("\n".join([row.scene, *profile_lines(row.profile_ms)]))
    if options.json_file:
        write_json(options.json_file, [asdict(r) for r in rows])
    if failed:
        sys.exit(BAD_RUN)


def scenes(name: str | None, list_parameters: bool, explained: bool, run: RunOptions) -> None:
    """Lists scenes or parameters, prints one scene, or explains the cost of its parts."""
    if explained:
        if not name:
            raise click.UsageError("--explain needs the NAME of a scene")
        click.echo(explain(at(load_scene(name, run.overrides), name, run).scene))
        return
    if run != RunOptions():
        raise click.UsageError("--set, --arch, --threads and --quality need --explain")
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
    """Returns a table of the cost and error of each quality of a shipped scene, line by line."""
    heads = ["--quality", "particles", "max wall s per s", "error % of depth"]
    rows = [
        [quality, cost.particles, f"{cost.slowest:.2f}", f"{100.0 * cost.error:.2f}"]
        for quality, cost in costs(name).items()
    ]
    return tabulate(rows, headers=heads, tablefmt="plain").splitlines() if rows else []


def record(
    loaded: LoadedScene,
    files: Outputs,
    options: CaptureOptions,
    recording: Recording | None,
    first: int,
    frames: int,
    process: Started | None,
) -> None:
    """Records a scene to files; after an interrupt the files are complete up to that frame. The
    simulation runs in `process`, or in this one."""
    size = options.size if files.pictures else None
    # Exported data are states of the solver at the times of frames, or at those of a session.
    how = {"free_steps": not files.data, **options_of(recording, options.resume)}
    fps, scene_path, text = options.fps, scene_file(files), loaded.toml()
    # A resumed recording finds the scene file of its first part.
    same = scene_path.is_file() and scene_path.read_bytes() == text.encode()
    if not same:
        check_files([scene_path], inputs_of(loaded.name, options))
        claim([scene_path], options.force)
    order = Order(
        [loaded.scene],
        files=Files(
            record=options.record_input,
            header=Header.of(loaded.name, loaded.quality, loaded.overrides),
            replay=recording,
            resume=Path(options.resume) if options.resume else None,
        ),
        options={**how, "meshes": files.surface, "density_every": math.inf},
        frame_time=1.0 / fps,
        frames=len(recording.frames) if recording else frames,
    )
    still = None if options.still_time is None else max(1, round(options.still_time * fps))
    with Remote(*process) if process else contextlib.nullcontext() as remote:
        row = remote.row(order, options.size) if remote else prepare_row(order, size)
        recorder = Recorder(files, frames, fps, still, first=first, sampled=recording is not None)
        recorder.aspect = options.size[0] / options.size[1]
        audience, witnesses = (recorder, []) if remote else with_files(recorder, row, order)
        row.lead.display.sprayed = files.sprayed
        if not same:
            replace(scene_path, text)
        try:
            run_loop(row, audience, witnesses=witnesses)
        except KeyboardInterrupt:
            say(f"stopped after {recorder.done} frames")
            raise
        finally:
            for warning in row.lead.warnings():
                say(f"warning: {warning}")
            for path in [*recorder.kept(), scene_path]:
                click.echo(path)
            row.close()


def default_output(scene: str, suffix: str) -> Path:
    """Returns an unused path in the folder out, named after the scene."""
    return Path("out") / f"{free_stem(Path('out'), Path(scene).stem)}{suffix}"


def inputs_of(scene: str, options: CaptureOptions) -> list[Path]:
    """Returns the files that a recording reads, and the name of a shipped scene as a path."""
    return [Path(given) for given in (scene, options.resume, options.replay) if given]


def scene_file(outputs: Outputs) -> Path:
    """Returns the path of a recording's scene file, next to the first output."""
    first = outputs.all()[0]
    stem = NUMBER.sub("", first.stem).rstrip("_-") or "capture"
    return first.with_name(stem + SCENE_SUFFIX)
