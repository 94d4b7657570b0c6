"""A virtual screen, and `play` on it, for tests of real windows."""

import contextlib
import os
import shutil
import subprocess
import time

import numpy as np
import pytest
import taichi as ti

from msph.cache_folder import TAICHI_FOLDER
from msph.stage.start_screen import SKY
from tests.command_kit import started

TOOLS = ("Xvfb", "xdotool")
WIDTH, HEIGHT = 640, 360
PATIENCE = 60.0
# Time [s] in which a window shows several frames, also on a busy machine.
PAUSE = 0.5
# Position of new windows on a screen without a window manager [pixels].
CORNER = 100
SCREEN = ("-screen", "0", f"{WIDTH + CORNER}x{HEIGHT + CORNER}x24")

missing = [t for t in TOOLS if not shutil.which(t)]
if missing and os.environ.get("MSPH_REQUIRE_WINDOW"):
    pytest.fail(f"the window test needs {', '.join(missing)}", pytrace=False)
needs_x = pytest.mark.skipif(bool(missing), reason=f"needs {', '.join(TOOLS)}")


def play(*arguments, display, folder=None, command="play", variables=(), **options):
    """Starts a command on a display, with further variables of its environment."""
    environment = {k: v for k, v in os.environ.items() if k not in ("DISPLAY", "WAYLAND_DISPLAY")}
    if folder:
        # With its own cache, the window offers no session that the user saved.
        environment["XDG_CACHE_HOME"] = str(folder / "cache")
        environment[TAICHI_FOLDER] = ti.cfg.offline_cache_file_path
    environment |= {"DISPLAY": display, **dict(variables)}
    options |= {"env": environment, "stdout": subprocess.PIPE, "stderr": subprocess.STDOUT}
    return started(command, *arguments, "--arch", "cpu", cwd=folder, **options)


@contextlib.contextmanager
def playing(screen, folder, *arguments, **options):
    """Context with a process of play() that fills a screen; it is killed at the end if it still
    runs."""
    size = "--size", f"{WIDTH}x{HEIGHT}"
    process = play(*arguments, *size, display=screen.display, folder=folder, **options)
    try:
        yield process
    finally:
        process.kill()
        process.wait()


class Screen:
    """Keyboard, mouse and image of the virtual screen. framebuffer: file of an X window dump."""

    def __init__(self, display, framebuffer):
        self.display, self.framebuffer = display, framebuffer

    def do(self, *arguments):
        """Sends commands of xdotool and waits: a drag needs a frame at each of its ends."""
        self.send(*arguments)
        time.sleep(PAUSE)

    def send(self, *arguments):
        """Sends commands of xdotool whose effect the test waits for."""
        environment = {**os.environ, "DISPLAY": self.display}
        subprocess.run(["xdotool", *map(str, arguments)], env=environment, check=True)

    def look(self):
        """Returns the image of the window as integers (height, width, 3)."""
        return read_xwd(self.framebuffer)[CORNER : CORNER + HEIGHT, CORNER : CORNER + WIDTH]

    def move(self, right, down, *more):
        """Moves the mouse to a position in the window [pixels] and sends more xdotool commands."""
        self.do("mousemove", CORNER + right, CORNER + down, *more)

    def differs(self, first, by):
        """Waits until the image differs from `first` by a mean of more than `by`, moving or not."""
        deadline = time.monotonic() + PATIENCE
        while np.abs(self.look() - first).mean() <= by:
            assert time.monotonic() < deadline, "the screen did not change"
            time.sleep(0.1)

    def still(self, unlike=None, by=0.0):
        """Returns the image once it no longer changes and differs from `unlike`, if any, by a mean
        of more than `by`. The first frame of a view waits for the compilation of its kernels."""
        deadline, last = time.monotonic() + PATIENCE, self.look()
        while time.monotonic() < deadline:
            time.sleep(PAUSE)
            before, last = last, self.look()
            changed = unlike is None or np.abs(last - unlike).mean() > by
            if changed and np.array_equal(before, last):
                return last
        raise AssertionError("the screen did not change" if unlike is not None else "not paused")

    def after(self, key, unlike, by):
        """Presses a key; returns the image at rest that then differs, see still()."""
        self.send("key", key)
        return self.still(unlike, by)

    def begun_moving(self):
        """Waits until the start screen is gone."""
        deadline, before = time.monotonic() + PATIENCE, ((0, 0, 0), SKY)
        while tuple(self.look()[0, 0]) in before:
            assert time.monotonic() < deadline, "nothing but the start is shown"
            time.sleep(0.2)

    def begun(self):
        """Returns the image at rest after the start screen, which also rests during compilation."""
        self.begun_moving()
        return self.still()


@contextlib.contextmanager
def virtual_screen(folder):
    """Yields a virtual screen just large enough for the window, and its server process."""
    read, write_end = os.pipe()
    server = subprocess.Popen(
        ["Xvfb", "-displayfd", str(write_end), "-fbdir", str(folder), *SCREEN],
        pass_fds=[write_end],
        stderr=subprocess.DEVNULL,
    )
    os.close(write_end)
    with os.fdopen(read) as pipe:
        number = pipe.readline().strip()
    yield Screen(f":{number}", folder / "Xvfb_screen0"), server
    server.terminate()
    server.wait()


def read_xwd(path):
    """Returns the pixels of an X window dump of 32 bits per pixel, blue first."""
    data = path.read_bytes()
    header = np.frombuffer(data[:100], dtype=">u4")
    size, width, height, stride, colours = header[0], *header[4:6], header[12], header[19]
    pixels = np.frombuffer(data, np.uint8, stride * height, size + 12 * colours)
    pixels = pixels.reshape(height, stride)[:, : 4 * width].reshape(height, width, 4)
    return pixels[:, :, 2::-1].astype(int)


def wait_for(process, text):
    """Returns the lines of a process up to a line with this text."""
    seen = ""
    while text not in seen:
        line = process.stdout.readline()
        assert line, f"play ended: {seen}"
        seen += line
    return seen


def wait_for_file(folder, pattern):
    deadline = time.monotonic() + PATIENCE
    while not list(folder.glob(pattern)):
        assert time.monotonic() < deadline, f"no {pattern}"
        time.sleep(0.2)
    return next(iter(folder.glob(pattern)))
