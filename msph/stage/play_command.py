"""Implementation of `msph play`."""

import contextlib
import shlex
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import click

from msph.device import start, started
from msph.interrupts import importing
from msph.options import PlayOptions, RunOptions
from msph.own_files import claim
from msph.stage.choice import SceneArguments
from msph.stage.lost_display import completing
from msph.stage.process import Started, simulations
from msph.stage.recorded_input import with_recording
from msph.stage.window import ClosedError, NoWindowError, check_display

if TYPE_CHECKING:
    from msph.stage.ggui_window import Window

# Largest number of simulations side by side; more images would be too narrow.
MAX_SIMULATIONS = 3


def play(scene: str | None, options: PlayOptions, run: RunOptions) -> None:
    """Runs a scene, and further ones chosen in its window; captures the scene if no window can be
    opened."""
    if options.record_input:
        claim([options.record_input], options.force)
    scene, run, recording = with_recording(scene, run, options.replay)
    if recording and not options.beside:
        options = replace(options, beside=recording.header.beside)
    if len(options.beside) >= MAX_SIMULATIONS:
        raise click.UsageError(f"--beside: at most {MAX_SIMULATIONS - 1}")
    for text in options.beside:
        try:
            shlex.split(text)
        except ValueError as error:
            raise click.UsageError(f"--beside {text}: {error}") from None
    arguments = SceneArguments(scene, run.overrides, options.beside)
    first = next(iter(arguments.scenes_of(scene).values()))
    with contextlib.ExitStack() as ends:
        # The other process imports its libraries while this one opens the window.
        process = ends.enter_context(simulations(run.arch, run.threads, not started()))
        try:
            check_display()
            process = process or ends.enter_context(simulations(run.arch, run.threads))
            window = opened(ends, process, run, first.title or scene, options.size)
        except NoWindowError as reason:
            with importing():
                from msph.stage.commands import capture_instead
            capture_instead(scene, options, run, str(reason), process)
            return
        except ClosedError:
            return
        # Imported after the window has opened.
        with importing():
            from msph.stage.keys import KEYS
            from msph.stage.remote import Remote
            from msph.stage.session import Files, Session
        for key in KEYS:
            click.echo(f"  {key.label:18} {key.effect}")
        files = Files(record=options.record_input, replay=recording)
        assert process
        session = Session(window, Remote(*process), arguments, options.frames, files)
        with contextlib.suppress(ClosedError):
            session.play(scene, run.quality)


def opened(
    ends: contextlib.ExitStack, process: Started | None, run: RunOptions, *window: Any
) -> "Window":
    """Opens a window until `ends` closes, while the process of its simulations, if any, starts;
    window: see Window. Raises NoWindowError, and ClosedError if the user closes the window at
    once."""
    if process:
        ends.enter_context(completing(process[0].kill))
    start(run.arch, run.threads)
    with importing():
        from msph.stage.ggui_window import Window
    found = Window(*window)
    ends.callback(found.close)
    return found
