"""The commands: play, capture, bench, measure, scenes."""

import json
import re
import sys
import time
from pathlib import Path

import click
from tabulate import tabulate
from tqdm import tqdm

import msph
from msph.device import ARCHES, ArchError, start
from msph.fluid.particles.neighbour_list import NeighbourOverflowError
from msph.fluid.trapped_water import TrappedWaterError
from msph.measure.ledger import NotFiniteError
from msph.measure.summary import water_laid
from msph.measure.timings import Timings
from msph.scene import SceneError, load_scene
from msph.scene.check import cautions
from msph.scene.library import DEFAULT_SCENE, find_scene, shipped_scenes
from msph.scene.load import read_toml, to_toml
from msph.scene.schema import Scene, parameters
from msph.stage.benchmark import benchmark, profile_lines, table_row
from msph.stage.controls import KEYS
from msph.stage.loop import run
from msph.stage.measurer import SCENE, Measurer
from msph.stage.recorder import MESH, NUMBER, OutputError, Recorder, check_outputs, make_writable
from msph.stage.show import Show
from msph.stage.window import NoWindowError, Window, check_display

# What `play` leaves behind where it cannot open a window.
FALLBACK_SECONDS = 10.0
FALLBACK_FPS = 30.0
FALLBACK_SIZE = (1280, 720)
STILL_TIME = 1.0
# Exit codes: wrong input, and a run that went wrong.
BAD_INPUT, BAD_RUN = 2, 1


class Size(click.ParamType):
    """WIDTHxHEIGHT in pixels."""

    name = "size"

    def convert(self, value, param, ctx):
        match = re.fullmatch(r"(\d+)x(\d+)", str(value))
        size = (int(match[1]), int(match[2])) if match else (0, 0)
        if not all(16 <= n <= 8192 for n in size):
            self.fail(f"{value!r} is no size such as 1280x720, 16 to 8192 each", param, ctx)
        return size


def shared_options(command):
    """What every command that builds a scene takes."""
    for option in (
        click.option(
            "--set",
            "overrides",
            multiple=True,
            metavar="KEY=VALUE",
            help="Set a scene parameter, e.g. --set box.restitution=0.2. Repeatable.",
        ),
        click.option(
            "--arch",
            type=click.Choice(ARCHES),
            default="auto",
            show_default=True,
            help="Where kernels run; auto takes CUDA or Metal where there is one, else the CPU.",
        ),
        click.option(
            "--threads",
            type=click.IntRange(min=1),
            help="CPU threads; with 1, runs repeat bit for bit.",
        ),
    ):
        command = option(command)
    return command


def say(text: str) -> None:
    """A line on the error stream, on its own even while a progress bar is shown."""
    tqdm.write(text, file=sys.stderr)


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(msph.__version__, prog_name="msph")
def cli():
    """M-SPH: real-time layered water, large particles in the depth, small ones at the surface."""


@cli.command()
@click.argument("scene", default=DEFAULT_SCENE)
@click.option("--size", type=Size(), default="960x540", show_default=True, help="Window size.")
@click.option("--frames", type=click.IntRange(min=1), help="Close after so many frames.")
@shared_options
def play(scene, size, frames, overrides, arch, threads):
    """Open a window on SCENE (a file or a shipped name) and play with its water.

    Where no window can be opened, ten seconds of the scene are captured instead.
    """
    loaded = load_scene(scene, overrides)
    try:
        check_display()
        start(arch, threads)
        window = Window(f"M-SPH: {loaded.title or scene}", size, frames)
    except NoWindowError as reason:
        target = Path("out") / Path(scene).stem
        say(f"{reason}: capturing {FALLBACK_SECONDS:.0f} s of {scene} instead")
        outputs = [target.with_suffix(".mp4"), target.with_suffix(".png")]
        check_outputs(outputs, [], [], FALLBACK_FPS)
        start(arch, threads)
        record(loaded, outputs, FALLBACK_SECONDS, FALLBACK_FPS, FALLBACK_SIZE, STILL_TIME)
        return
    for key, meaning in KEYS:
        click.echo(f"  {key:18} {meaning}")
    budget = loaded.play.budget or None
    show = prepare(loaded, window.FRAME_TIME, size, budget=budget, stop_bodies=True)
    run(show, window)
    for warning in show.warnings():
        say(f"warning: {warning}")


@cli.command()
@click.argument("scene", default=DEFAULT_SCENE)
@click.option(
    "-o",
    "--output",
    "outputs",
    multiple=True,
    type=click.Path(path_type=Path),
    help="out.mp4 (.mov .mkv .webm), out.gif, out.png, or out_%04d.png. Repeatable.  "
    "[default: out/SCENE.mp4]",
)
@click.option(
    "--mesh",
    "meshes",
    multiple=True,
    type=click.Path(path_type=Path),
    help="Also write the surface of every frame: out_%04d.ply or .obj.",
)
@click.option(
    "--particles",
    multiple=True,
    type=click.Path(path_type=Path),
    help="Also write the particles of every frame: out_%04d.csv, or .npz, a checkpoint.",
)
@click.option(
    "--resume", type=click.Path(exists=True, dir_okay=False), help="Go on from a .npz checkpoint."
)
@click.option(
    "--seconds", type=click.FloatRange(min=0, min_open=True), help="Default: the scene's duration."
)
@click.option(
    "--fps",
    type=click.FloatRange(min=1, max=10000),
    default=30.0,
    show_default=True,
    help="Frames per simulated second.",
)
@click.option("--size", type=Size(), default="1280x720", show_default=True, help="Picture size.")
@shared_options
def capture(
    scene, outputs, meshes, particles, resume, seconds, fps, size, overrides, arch, threads
):
    """Record SCENE offscreen: video, pictures, meshes, particles. Needs no display."""
    loaded = load_scene(scene, overrides)
    extra = [*meshes, *particles]
    outputs = list(outputs) or ([] if extra else [Path("out") / f"{Path(scene).stem}.mp4"])
    check_outputs(outputs, list(meshes), list(particles), fps)
    start(arch, threads)
    record(loaded, [*outputs, *extra], seconds or loaded.duration, fps, size, resume=resume)


@cli.command()
@click.argument("scenes", nargs=-1)
@click.option("--seconds", type=click.FloatRange(min=0, min_open=True), help="Simulated time.")
@click.option("--no-render", is_flag=True, help="Time the fluid alone.")
@click.option("--size", type=Size(), default="640x360", show_default=True, help="Picture size.")
@click.option(
    "--profile",
    is_flag=True,
    help="Also print the time of each part of a frame. Slows the run, so the table's figures too: "
    "the device is waited for round each part.",
)
@click.option(
    "--json", "json_file", type=click.Path(path_type=Path), help="Also write the rows to a file."
)
@shared_options
def bench(scenes, seconds, no_render, size, profile, json_file, overrides, arch, threads):
    """Time SCENES (default: all shipped) without a window, and print speed beside error.

    A frame is 1/60 s of simulated time. Exits with 1 when the water does not stay finite.
    """
    names = scenes or tuple(shipped_scenes())
    if json_file:
        make_writable(json_file)
    loaded = [(name, load_scene(name, overrides)) for name in names]
    arch = start(arch, threads)
    rows, failed = [], False
    for name, scene in loaded:
        say(f"{name}: compiling kernels, then running")
        try:
            duration = seconds or scene.duration
            rows.append(benchmark(scene, name, duration, not no_render, size, profile))
        except (NotFiniteError, NeighbourOverflowError, TrappedWaterError) as error:
            say(f"{name}: FAILED: {error}")
            failed = True
    if rows:
        click.echo(f"arch {arch}, frames of 1/60 s, milliseconds per frame, medians by stage")
        click.echo(tabulate([table_row(r) for r in rows], headers="keys", tablefmt="github"))
    if rows and profile:
        click.echo("\nprofiled, which slows the run: so are the figures above; means per frame")
        for row in rows:
            click.echo("\n".join([row.scene, *profile_lines(row.profile_ms)]))
    if json_file:
        json_file.write_text(json.dumps([r.as_dict() for r in rows], indent=2) + "\n")
    if failed:
        sys.exit(BAD_RUN)


@cli.command()
@click.argument("scene", default=DEFAULT_SCENE)
@click.option(
    "-o",
    "--output",
    "folder",
    type=click.Path(path_type=Path),
    help="Folder for ledger.csv, probes.csv, summary.json, scene.toml.  [default: out/SCENE]",
)
@click.option("--seconds", type=float, help="Sets duration: the simulated time.")
@click.option("--every", type=float, help="Sets measure.every: seconds between two rows.")
@shared_options
def measure(scene, folder, seconds, every, overrides, arch, threads):
    """Run SCENE without a window; write its ledger and probes as CSV, and a summary as JSON.

    Works for any scene. A run that fails keeps what it measured, and exits with 1.
    """
    given = {"duration": seconds, "measure.every": every}
    options = [f"{key}={value}" for key, value in given.items() if value is not None]
    loaded = load_scene(scene, (*overrides, *options))
    folder = folder or Path("out") / Path(scene).stem
    make_writable(folder / SCENE)
    arch = start(arch, threads)
    (folder / SCENE).write_text(to_toml(loaded), encoding="utf-8")
    measurer = Measurer(folder, loaded, scene, arch)
    try:
        show = prepare(loaded, loaded.measure.every, timings=Timings())
        run(show, measurer)
    except (Exception, KeyboardInterrupt) as error:
        measurer.conclude(str(error) or "interrupted")
        say(f"{folder} holds what was measured until then")
        raise
    for path in measurer.conclude():
        click.echo(path)


@cli.command()
@click.argument("name", required=False)
@click.option("--parameters", "list_parameters", is_flag=True, help="List every scene parameter.")
def scenes(name, list_parameters):
    """List the shipped scenes, or print the one called NAME."""
    if list_parameters:
        rows = [p.row() for p in parameters(Scene)]
        click.echo(tabulate(rows, headers="keys", tablefmt="simple"))
    elif name:
        path = find_scene(name)
        read_toml(path)
        click.echo(path.read_text(encoding="utf-8").rstrip())
    else:
        rows = []
        for key, path in shipped_scenes().items():
            data = read_toml(path)
            title = data.get("title", "")
            if "variants" in data:
                title += f" (--set variant={'|'.join(data['variants'])})"
            rows.append((key, title))
        click.echo(tabulate(rows, tablefmt="plain"))


def prepare(scene: Scene, frame_time: float, size=None, **options) -> Show:
    """Builds a show, with the options it has, and compiles its kernels, saying so."""
    begin = time.perf_counter()
    for caution in cautions(scene):
        say(f"warning: {caution}")
    say("compiling kernels ...")
    show = Show(scene, frame_time, size, **options)
    show.warm_up()
    ready = f"ready in {time.perf_counter() - begin:.1f} s, {sum(show.counts):,} particles, "
    ready += laid_and_asked(water_laid(scene, show.simulation, show.counts))
    if show.simulation.left_out:
        ready += (
            f"; {show.simulation.left_out:,} inside obstacles or outside the container left out"
        )
    say(ready)
    return show


def laid_and_asked(water: dict[str, float]) -> str:
    """Mass of the water in words, and what the scene asked for where four digits differ."""
    laid, asked = (f"{water[key]:.4g} kg" for key in ("mass_laid_kg", "mass_asked_kg"))
    return laid if laid == asked else f"{laid} of {asked} asked"


def record(
    scene: Scene,
    outputs: list[Path],
    seconds: float,
    fps: float,
    size: tuple[int, int],
    still_time: float | None = None,
    resume: str | None = None,
) -> None:
    """Runs a scene for the recorder; an interrupt ends the recording, not the files."""
    pictures = any(p.suffix not in (*MESH, ".npz", ".csv") for p in outputs)
    meshes = any(p.suffix in MESH for p in outputs)
    show = prepare(scene, 1.0 / fps, size if pictures else None, meshes=meshes, density=False)
    if resume:
        show.resume(Path(resume))
    still = None if still_time is None else max(1, round(still_time * fps))
    recorder = Recorder(outputs, max(1, round(seconds * fps)), fps, still)
    # Never the name of a scene that somebody wrote: .scene.toml is ours.
    stem = NUMBER.sub("", outputs[0].stem).rstrip("_-") or "capture"
    beside = outputs[0].with_name(stem + ".scene.toml")
    beside.write_text(to_toml(scene), encoding="utf-8")
    try:
        run(show, recorder)
    except KeyboardInterrupt:
        say(f"stopped after {recorder.done} frames")
    for warning in show.warnings():
        say(f"warning: {warning}")
    for path in [*outputs, beside]:
        click.echo(path)


def main(arguments: list[str] | None = None) -> None:
    """The command line; every error is one line, wrong input exits with 2."""
    try:
        cli.main(arguments, prog_name="msph", standalone_mode=False)
    except click.exceptions.NoArgsIsHelpError as error:
        error.show()
        sys.exit(BAD_INPUT)
    except click.ClickException as error:
        say(f"msph: {error.format_message()}")
        sys.exit(BAD_INPUT)
    except (SceneError, OutputError, ArchError) as error:
        say(f"msph: {error}")
        sys.exit(BAD_INPUT)
    except (NotFiniteError, NeighbourOverflowError) as error:
        say(f"msph: the water blew up: {error}")
        sys.exit(BAD_RUN)
    except TrappedWaterError as error:
        say(f"msph: {error}")
        sys.exit(BAD_RUN)
    except (click.Abort, KeyboardInterrupt):
        say("msph: interrupted")
        sys.exit(130)
