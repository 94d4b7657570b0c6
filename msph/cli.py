"""Command line: play, capture, bench, measure, scenes, lesson.

The modules of msph/stage that implement the commands are imported when a command runs:
help and option errors import neither Taichi nor numpy.
"""

import functools
import math
import re
from pathlib import Path
from typing import Any

import click
from click.core import ParameterSource

from msph import cache_folder, device, own_files
from msph.constants import VERSION
from msph.device import ARCHES
from msph.ending import exit_on_error
from msph.errors import BadInputError
from msph.interrupts import importing
from msph.options import (
    AS_GIVEN,
    AS_RECORDED,
    AUTO,
    QUALITIES,
    BenchOptions,
    CaptureOptions,
    MeasureOptions,
    PlayOptions,
    RunOptions,
)

# Range of --converge: two runs give no order; the coarsest of six would have 1/6 of the resolution.
CONVERGENCE_RUNS = (3, 5)


class Finite(click.FloatRange):
    """Finite number in a range; click itself accepts nan and inf."""

    def convert(self, value, param, ctx):
        number = super().convert(value, param, ctx)
        if not math.isfinite(number):
            self.fail(f"{value!r} is not a finite number", param, ctx)
        return number


class Size(click.ParamType):
    """Image size WIDTHxHEIGHT in pixels."""

    name = "size"

    def convert(self, value, param, ctx):
        match = re.fullmatch(r"(\d+)x(\d+)", str(value))
        size = (int(match[1]), int(match[2])) if match else (0, 0)
        if not all(16 <= n <= 8192 for n in size):
            self.fail(f"{value!r}: expected WIDTHxHEIGHT, each 16 to 8192", param, ctx)
        return size


# Parameter types that several options share.
FILE, CHECKPOINT = click.Path(path_type=Path), click.Path(exists=True, dir_okay=False)
FILES: dict[str, Any] = {"multiple": True, "type": FILE}
# Longest simulated time [s]: that of a scene.
DURATION = Finite(min=0, min_open=True, max=1e6)

arch_option = click.option(
    "--arch",
    type=click.Choice(ARCHES),
    default="auto",
    show_default=True,
    help="Device that runs the kernels; auto is CUDA if available, else the CPU.",
)
threads_option = click.option(
    "--threads",
    type=click.IntRange(min=1),
    help="Number of CPU threads; with 1, runs are bitwise reproducible.",
)


def shared_options(quality=AS_GIVEN):
    """Returns a decorator that adds the options of commands that build a scene, passed as `run`.
    quality: default of --quality."""
    options = (
        click.option(
            "--set",
            "overrides",
            multiple=True,
            metavar="KEY=VALUE",
            help="Set a scene parameter, e.g. --set box.restitution=0.2. Repeatable.",
        ),
        arch_option,
        threads_option,
        click.option(
            "--quality",
            type=click.Choice((AUTO, *QUALITIES)),
            default=quality,
            show_default=True,
            help="Resolution: large is that of the scene file; auto is the finest one that runs in "
            "real time on this machine, measured before the start.",
        ),
    )

    def with_options(command):
        @functools.wraps(command)
        def bundled(overrides, arch, threads, quality, **own):
            source = click.get_current_context().get_parameter_source("quality")
            if own.get("replay") and source is ParameterSource.DEFAULT:
                quality = AS_RECORDED
            return command(run=RunOptions(overrides, arch, threads, quality), **own)

        for option in options:
            bundled = option(bundled)
        return bundled

    return with_options


window_size_option = click.option(
    "--size", type=Size(), default="960x540", show_default=True, help="Window size."
)
frames_option = click.option(
    "--frames", type=click.IntRange(min=1), help="Close the window after this number of frames."
)
replay_option = click.option(
    "--replay",
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    metavar="FILE",
    help="Repeat the input that `play --record-input FILE` has recorded, with its scene, quality "
    "and parameters; --quality and --set change them.",
)
force_option = click.option("--force", is_flag=True, help="Overwrite existing files.")


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(VERSION, prog_name="msph")
def cli():
    """M-SPH: real-time multi-layer SPH, large particles in the depth, small ones at the surface."""
    click.get_current_context().call_on_close(own_files.release)
    cache_folder.ensure(lambda line: click.echo(f"msph: {line}", err=True))


@cli.command()
@click.argument("scene", required=False)
@window_size_option
@frames_option
@click.option(
    "--beside",
    multiple=True,
    metavar="'KEY=VALUE ...'",
    help="Compare with the scene changed by these parameters: both run side by side with the same "
    "input, with the speed and error of each. May be given twice.",
)
@click.option(
    "--record-input",
    type=FILE,
    metavar="FILE",
    help="Record all input (drags, tools, tilt, jolts, sliders, resets) until another scene, "
    "quality or checkpoint is chosen, as JSON lines, frame by frame.",
)
@replay_option
@force_option
@shared_options(AUTO)
def play(scene, run, **options):
    """Run SCENE (a file or a shipped name) interactively in a window.

    If no window can be opened, the first 10 s of the scene are captured instead. A session is saved
    every 5 s; after a crash, the next one offers to continue it.
    """
    with importing():
        from msph.stage import play_command
    play_command.play(scene, PlayOptions(**options), run)


@cli.command()
@click.argument("scene", required=False)
@click.option(
    "-o",
    "--output",
    "outputs",
    **FILES,
    help="out.mp4 (.mov .mkv .webm), out.webp, out.gif, out.png, or out_%04d.png. Repeatable.  "
    "[default: out/SCENE.mp4]",
)
@click.option(
    "--mesh",
    "meshes",
    **FILES,
    help="Also write the surface mesh of every frame, with the velocity and the share of foam at "
    "each vertex: out_%04d.ply, .obj, or .vtu for ParaView.",
)
@click.option("--mesh-layer", is_flag=True, help="--mesh and --usd: the layer at each vertex.")
@click.option(
    "--droplets",
    **FILES,
    help="Also write the spray of every frame as droplets, points with radius and velocity: "
    "out_%04d.ply or .vtu. Meshes then lack the spray.",
)
@click.option(
    "--particles",
    **FILES,
    help="Also write the particles of every frame: out_%04d.csv, .vtu for ParaView, or .npz "
    "(checkpoint).",
)
@click.option(
    "--bodies",
    **FILES,
    help="Also write the bodies: out_%04d.vtu, with their motion and the forces on them, or "
    "out.obj, with a table of their transforms (out.csv).",
)
@click.option(
    "--usd",
    **FILES,
    help="Also write surface, droplets, bodies and camera of all frames to out.usdc or .usda, for "
    "Blender and others; needs usd-core.",
)
@click.option("--resume", type=CHECKPOINT, help="Continue from this .npz file.")
@click.option(
    "--seconds",
    type=DURATION,
    help="Simulated time at which the recording ends [s].  [default: the scene's duration]",
)
@click.option(
    "--fps",
    type=Finite(min=1, max=10000),
    default=30.0,
    show_default=True,
    help="Frames per simulated second.",
)
@click.option("--size", type=Size(), default="1280x720", show_default=True, help="Image size.")
@replay_option
@force_option
@shared_options()
def capture(scene, run, **options):
    """Record SCENE headless: video, images, meshes, particles, bodies."""
    with importing():
        from msph.stage.process import simulations
    given = CaptureOptions(**options)
    # Simulation and images compile and run at the same time. Files of data need the simulation, and
    # a program that runs Taichi has compiled kernels.
    both = not (given.data or device.started())
    with simulations(run.arch, run.threads, both) as process:
        commands().capture(scene, given, run, process)


@cli.command()
@click.argument("scenes", nargs=-1)
@click.option(
    "--seconds", type=DURATION, help="Simulated time [s].  [default: the scene's duration]"
)
@click.option(
    "--no-render", is_flag=True, help="Run the simulation only, without surface and image."
)
@click.option(
    "--play",
    "as_played",
    is_flag=True,
    help="Run as `play` does, for --seconds of wall-clock time: reports displayed frames/s and "
    "the real-time factor.",
)
@click.option("--size", type=Size(), help="Image size.  [default: 640x360, with --play 960x540]")
@click.option(
    "--profile",
    is_flag=True,
    help="Also print the time of each part of a frame. Synchronizes the device around each part, "
    "which slows the run and increases all times.",
)
@click.option("--json", "json_file", type=FILE, help="Also write the rows as JSON.")
@replay_option
@force_option
@shared_options()
def bench(scenes, run, **options):
    """Benchmark SCENES (default: all shipped) headless; print speed and errors.

    A frame is 1/60 s of simulated time. The exit status is 1 if a simulation becomes unstable.
    """
    commands().bench(scenes, BenchOptions(**options), run)


@cli.command()
@click.argument("scene", required=False)
@click.option(
    "-o",
    "--output",
    "folder",
    type=FILE,
    help="Folder for ledger.csv, probes.csv, plots, summary.json, scene.toml and checkpoint.npz.  "
    "[default: out/SCENE]",
)
@click.option(
    "--seconds",
    type=float,
    help="Simulated time at which the run ends [s].  [default: the scene's duration]",
)
@click.option(
    "--every", type=float, help="Time between two rows of the tables [s]; sets measure.every."
)
@click.option(
    "--converge",
    type=click.IntRange(*CONVERGENCE_RUNS),
    metavar="N",
    help="Run the scene at N (3 to 5) particle spacings, the coarsest first, estimate its "
    "discretisation error, and write convergence.csv.",
)
@click.option(
    "--resume",
    type=CHECKPOINT,
    help="Continue from a checkpoint.npz to the scene's duration and append to the tables.",
)
@replay_option
@force_option
@shared_options()
def measure(scene, run, **options):
    """Run SCENE headless; write conserved quantities, errors and probes over time.

    The files are tables (CSV), plots and a summary (JSON). At the end, the errors of the run are
    printed, each with the limit of an accurate run. If a run fails, the files written until then
    remain, and the exit status is 1.
    """
    with importing():
        from msph.measure import commands as measures
    measures.measure(scene, MeasureOptions(**options), run)


@cli.command()
@click.argument("name", required=False)
@click.option("--parameters", "list_parameters", is_flag=True, help="List every scene parameter.")
@click.option(
    "--explain",
    "explained",
    is_flag=True,
    help="Run NAME with and without each of its enabled parts; print the cost of each part and "
    "the error without it. Takes a minute.",
)
@shared_options()
def scenes(**options):
    """List the shipped scenes, or print the file of the scene NAME.

    --quality, --threads, --arch and --set require --explain.
    """
    commands().scenes(**options)


@cli.command()
@click.argument("name", required=False)
@click.option("--html", type=FILE, metavar="DIR", help="Write the lesson as a web page to DIR.")
@click.option("--slides", type=FILE, metavar="DIR", help="Write the lesson as images to DIR.")
@window_size_option
@frames_option
@force_option
@arch_option
@threads_option
def lesson(arch, threads, **options):
    """List the lessons, or run the lesson NAME (or a lesson folder) in a window.

    The web page of --html is self-contained; the images of --slides are numbered and have
    captions. Both show the solution of the lesson.
    """
    with importing():
        from msph.lesson import commands as lessons
    lessons.lesson(run=RunOptions(arch=arch, threads=threads), **options)


def check_values(command: str, **values: Any) -> None:
    """Raises BadInputError, with the command's text, for values that its options refuse."""
    options = {p.name: p for p in cli.commands[command].params}
    for name, value in values.items():
        try:
            options[name].type_cast_value(click.Context(cli), value)
        except click.BadParameter as error:
            error.param = options[name]
            raise BadInputError(error.format_message()) from None


def commands():
    """Imports and returns the module that implements most commands."""
    with importing():
        from msph.stage import commands
    return commands


def main(arguments: list[str] | None = None) -> None:
    """Runs the command line; errors end the process as in msph/ending.py."""
    with exit_on_error():
        cli.main(arguments, prog_name="msph", standalone_mode=False)
