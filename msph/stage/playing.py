"""What `msph play` does: a window here, and each water in a process of its own."""

import shlex
import sys

import click

from msph.device import start
from msph.interrupts import importing
from msph.stage.choice import Called, Choice
from msph.stage.water_process import WaterProcess
from msph.stage.window import NoWindowError, check_display

# Waters that are played side by side: more are too narrow to be seen.
MOST_WATERS = 3


def play(scene, size, frames, beside, overrides, arch, threads, quality) -> None:
    """Plays a scene, and what is chosen in its window after it; captures the scene where none can
    be opened."""
    check_beside(beside)
    called = Called(scene, overrides, beside, arch, threads, frames, size)
    try:
        check_display()
        code = in_window(called, quality)
    except NoWindowError as reason:
        with importing():
            from msph.stage.commands import capture_instead
        capture_instead(called, quality, str(reason))
    else:
        sys.exit(code)


def in_window(called: Called, quality: str) -> int:
    """Plays in a window; the exit code. Raises NoWindowError."""

    def begin(choice: Choice) -> WaterProcess:
        return WaterProcess(choice, called)

    first = begin(Choice(called.scene, quality))
    try:
        # A water's process imports and loads while this one does.
        with importing():
            from msph.stage.controls import KEYS
            from msph.stage.ggui_window import GguiWindow
            from msph.stage.window_server import WindowServer
        # Taichi only shows pictures here.
        start("cpu", threads=1)

        def open_window(title: str) -> GguiWindow:
            window = GguiWindow(title, called.size)
            for key in KEYS:
                click.echo(f"  {key.shown:18} {key.does}")
            return window

        return WindowServer(first, begin, open_window).serve()
    finally:
        first.leave()


def check_beside(beside: tuple[str, ...]) -> None:
    """Raises UsageError where these are no overrides of waters beside the scene."""
    if len(beside) >= MOST_WATERS:
        raise click.UsageError(f"--beside: at most {MOST_WATERS - 1}")
    for text in beside:
        try:
            shlex.split(text)
        except ValueError as error:
            raise click.UsageError(f"--beside {text}: {error}") from None
