"""The command line: play, capture, bench, measure, scenes, lesson.

What a command does is in msph/stage/commands.py, imported when the command is called:
help and wrong options need neither Taichi nor numpy.
"""

import functools
import math
import re
from pathlib import Path

import click

import msph
from msph.device import ARCHES
from msph.ending import exit_on_error
from msph.interrupts import importing
from msph.options import (
    AS_GIVEN,
    AUTO,
    QUALITIES,
    BenchOptions,
    CaptureOptions,
    MeasureOptions,
    PlayOptions,
    RunOptions,
)

# With two runs no order is known; of six the first would have a sixth of the scene's resolution.
CONVERGENCE_RUNS = (3, 5)


class Finite(click.FloatRange):
    """A number in a range; click lets nan and inf through."""

    def convert(self, value, param, ctx):
        number = super().convert(value, param, ctx)
        if not math.isfinite(number):
            self.fail(f"{value!r} is no finite number", param, ctx)
        return number


class Size(click.ParamType):
    """WIDTHxHEIGHT in pixels."""

    name = "size"

    def convert(self, value, param, ctx):
        match = re.fullmatch(r"(\d+)x(\d+)", str(value))
        size = (int(match[1]), int(match[2])) if match else (0, 0)
        if not all(16 <= n <= 8192 for n in size):
            self.fail(f"{value!r} is no size such as 1280x720, 16 to 8192 each", param, ctx)
        return size


arch_option = click.option(
    "--arch",
    type=click.Choice(ARCHES),
    default="auto",
    show_default=True,
    help="Where kernels run; auto takes CUDA where there is one, else the CPU.",
)
threads_option = click.option(
    "--threads",
    type=click.IntRange(min=1),
    help="CPU threads; with 1, runs repeat bit for bit.",
)


def shared_options(quality=AS_GIVEN):
    """Options of every command that builds a scene, given to the command as `run`; quality: the
    default."""
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
            help="Size of the particles: large is the scene as it is written, auto tries which is "
            "the finest that plays in real time.",
        ),
    )

    def with_options(command):
        @functools.wraps(command)
        def bundled(overrides, arch, threads, quality, **own):
            return command(run=RunOptions(overrides, arch, threads, quality), **own)

        for option in options:
            bundled = option(bundled)
        return bundled

    return with_options


force_option = click.option(
    "--force", is_flag=True, help="Write over files, too, that no run wrote."
)


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(msph.__version__, prog_name="msph")
def cli():
    """M-SPH: real-time layered water, large particles in the depth, small ones at the surface."""


@cli.command()
@click.argument("scene", default=msph.DEFAULT_SCENE)
@click.option("--size", type=Size(), default="960x540", show_default=True, help="Window size.")
@click.option("--frames", type=click.IntRange(min=1), help="Close after so many frames.")
@click.option(
    "--beside",
    multiple=True,
    metavar="'KEY=VALUE ...'",
    help="Compare: also run the scene with these changes side by side, with the same input; the "
    "speed and error of each are shown. Up to twice.",
)
@shared_options(AUTO)
def play(scene, run, **options):
    """Open a window on SCENE (a file or a shipped name) and play with its water.

    Where no window can be opened, ten seconds of the scene are captured instead.
    """
    with importing():
        from msph.stage import playing
    playing.play(scene, PlayOptions(**options), run)


@cli.command()
@click.argument("scene", default=msph.DEFAULT_SCENE)
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
    help="Also write the surface of every frame: out_%04d.ply, .obj, or .vtu for ParaView.",
)
@click.option(
    "--particles",
    multiple=True,
    type=click.Path(path_type=Path),
    help="Also write the particles of every frame: out_%04d.csv, .vtu for ParaView, or .npz, a "
    "checkpoint.",
)
@click.option(
    "--resume", type=click.Path(exists=True, dir_okay=False), help="Go on from a .npz checkpoint."
)
@click.option("--seconds", type=Finite(min=0, min_open=True), help="Default: the scene's duration.")
@click.option(
    "--fps",
    type=Finite(min=1, max=10000),
    default=30.0,
    show_default=True,
    help="Frames per simulated second.",
)
@click.option("--size", type=Size(), default="1280x720", show_default=True, help="Picture size.")
@force_option
@shared_options()
def capture(scene, run, **options):
    """Record SCENE offscreen: video, pictures, meshes, particles. Needs no display."""
    commands().capture(scene, CaptureOptions(**options), run)


@cli.command()
@click.argument("scenes", nargs=-1)
@click.option("--seconds", type=Finite(min=0, min_open=True), help="Simulated time.")
@click.option("--no-render", is_flag=True, help="Time the fluid alone.")
@click.option(
    "--play",
    "as_played",
    is_flag=True,
    help="Run as a window would, by the wall clock: shown frames/s, how fast time goes.",
)
@click.option("--size", type=Size(), help="Picture size.  [default: 640x360, with --play 960x540]")
@click.option(
    "--profile",
    is_flag=True,
    help="Also print the time of each part of a frame. Slows the run, so the table's figures too: "
    "the device is waited for round each part.",
)
@click.option(
    "--json", "json_file", type=click.Path(path_type=Path), help="Also write the rows to a file."
)
@shared_options()
def bench(scenes, run, **options):
    """Time SCENES (default: all shipped) without a window, and print speed beside error.

    A frame is 1/60 s of simulated time. Exits with 1 when the water does not stay finite.
    """
    commands().bench(scenes, BenchOptions(**options), run)


@cli.command()
@click.argument("scene", default=msph.DEFAULT_SCENE)
@click.option(
    "-o",
    "--output",
    "folder",
    type=click.Path(path_type=Path),
    help="Folder for ledger.csv, probes.csv, plots, summary.json, scene.toml and checkpoint.npz.  "
    "[default: out/SCENE]",
)
@click.option("--seconds", type=float, help="Sets duration: the simulated time.")
@click.option("--every", type=float, help="Sets measure.every: seconds between two rows.")
@click.option(
    "--converge",
    type=click.IntRange(*CONVERGENCE_RUNS),
    metavar="N",
    help="Run the scene at N spacings (3 to 5), coarse ones first, and estimate the error that its "
    "own spacing makes: convergence.csv.",
)
@click.option(
    "--resume",
    type=click.Path(exists=True, dir_okay=False),
    help="Go on from a checkpoint.npz up to the scene's duration; tables in the folder grow.",
)
@force_option
@shared_options()
def measure(scene, run, **options):
    """Run SCENE without a window; write its ledger and probes as CSV, plots and a summary.

    Prints last how wrong the run is, each figure beside what good runs keep. Works for any scene. A
    run that fails keeps what it measured, and exits with 1.
    """
    commands().measure(scene, MeasureOptions(**options), run)


@cli.command()
@click.argument("name", required=False)
@click.option("--parameters", "list_parameters", is_flag=True, help="List every scene parameter.")
@click.option(
    "--explain",
    "explained",
    is_flag=True,
    help="Run NAME with and without each part that it has switched on: what each costs, and the "
    "error without it. Takes a minute.",
)
@shared_options()
def scenes(**options):
    """List the shipped scenes, or print the one called NAME."""
    commands().scenes(**options)


@cli.command()
@click.argument("name", required=False)
@click.option("--html", type=click.Path(path_type=Path), metavar="DIR", help="Write a page.")
@click.option("--slides", type=click.Path(path_type=Path), metavar="DIR", help="Write pictures.")
@click.option("--size", type=Size(), default="960x540", show_default=True, help="Window size.")
@click.option("--frames", type=click.IntRange(min=1), help="Close after so many frames.")
@arch_option
@threads_option
def lesson(arch, threads, **options):
    """List the lessons, or run the one called NAME (or in a folder) in a window.

    --html writes it as a page that needs no network, --slides as numbered pictures with captions:
    both do what the lesson's solution says.
    """
    with importing():
        from msph.lesson import commands as lessons
    lessons.lesson(run=RunOptions(arch=arch, threads=threads), **options)


def commands():
    """The module of what commands do."""
    with importing():
        from msph.stage import commands
    return commands


def main(arguments: list[str] | None = None) -> None:
    """The command line; errors as msph/ending.py says."""
    with exit_on_error():
        cli.main(arguments, prog_name="msph", standalone_mode=False)
