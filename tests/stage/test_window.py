"""Tests of a real window under Xvfb: images, keys, mouse, and lost or missing displays."""

import contextlib
import json
import os
import shutil
import signal
import subprocess
import sys
import time

import imageio.v2 as imageio
import numpy as np
import pytest
import taichi as ti

from msph.cache_folder import TAICHI_FOLDER
from msph.lesson.paint import CAPTION, LINE, NAME, PAD, band_height
from msph.measure.past import time_of
from msph.options import QUALITIES
from msph.scene.load import read_toml
from msph.stage import commands
from msph.stage.layout import GAP
from msph.stage.pacer import Pacer
from msph.stage.pages import text_height
from msph.stage.recording import read
from msph.stage.start_screen import SKY
from msph.stage.status import pace
from tests.command_kit import here
from tests.scenes_kit import write

TOOLS = ("Xvfb", "xdotool")
WIDTH, HEIGHT = 640, 360
PATIENCE = 60.0
# Position of new windows on a screen without a window manager [pixels].
CORNER = 100
SCREEN = ("-screen", "0", f"{WIDTH + CORNER}x{HEIGHT + CORNER}x24")

missing = [t for t in TOOLS if not shutil.which(t)]
if missing and os.environ.get("MSPH_REQUIRE_WINDOW"):
    pytest.fail(f"the window test needs {', '.join(missing)}", pytrace=False)
needs_x = pytest.mark.skipif(bool(missing), reason=f"needs {', '.join(TOOLS)}")


def play(
    *arguments,
    display=None,
    folder=None,
    run=("-m", "msph"),
    command="play",
    start_new_session=False,
    **more,
):
    environment = {k: v for k, v in os.environ.items() if k not in ("DISPLAY", "WAYLAND_DISPLAY")}
    if folder:
        # With its own cache, the window offers no session that the user saved.
        environment["XDG_CACHE_HOME"] = str(folder / "cache")
        environment[TAICHI_FOLDER] = ti.cfg.offline_cache_file_path
    environment |= more
    if display:
        environment["DISPLAY"] = display
    command = [sys.executable, "-u", *run, command, *arguments, "--arch", "cpu"]
    return subprocess.Popen(
        command,
        env=environment,
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=start_new_session,
        # Tests started in the background ignore SIGINT, and so would the processes that they start.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )


class Screen:
    """Keyboard, mouse and image of the virtual screen. framebuffer: file of an X window dump."""

    def __init__(self, display, framebuffer):
        self.display, self.framebuffer = display, framebuffer

    def do(self, *arguments):
        """Sends commands of xdotool and waits: a drag needs a frame at each of its ends."""
        self.send(*arguments)
        time.sleep(0.7)

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
            time.sleep(0.7)
            before, last = last, self.look()
            changed = unlike is None or np.abs(last - unlike).mean() > by
            if changed and np.array_equal(before, last):
                return last
        raise AssertionError("the screen did not change" if unlike is not None else "not paused")

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


@pytest.fixture(scope="module")
def display(tmp_path_factory):
    with virtual_screen(tmp_path_factory.mktemp("screen")) as (screen, _):
        yield screen


def read_xwd(path):
    """Returns the pixels of an X window dump of 32 bits per pixel, blue first."""
    data = path.read_bytes()
    header = np.frombuffer(data[:100], dtype=">u4")
    size, width, height, stride, colours = header[0], *header[4:6], header[12], header[19]
    pixels = np.frombuffer(data, np.uint8, stride * height, size + 12 * colours)
    pixels = pixels.reshape(height, stride)[:, : 4 * width].reshape(height, width, 4)
    return pixels[:, :, 2::-1].astype(int)


def test_pace_shows_when_time_is_slow():
    pacer = Pacer(60.0)
    assert pace(pacer, paused=False) == "real time"
    assert pace(pacer, paused=True) == "paused"
    for _ in range(60):
        pacer.record(0.02, 0.01, 0.004, 0.003, 0.0084)
    assert pace(pacer, paused=False) == "0.42 times real time"
    pacer.set_speed(0.1)
    assert pace(pacer, paused=False) == "0.10 times real time"


# Runs `python -m msph` with the given scene as the only shipped scene.
ALONE = """
import pathlib
import sys
import msph.scene.library as library
library.shipped_scenes = lambda: {sys.argv[2]: pathlib.Path(sys.argv[2])}
import msph.cli
msph.cli.main()
"""


def wait_for(process, text, seen=""):
    """Returns `seen` and further lines of a process, up to a line with this text."""
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


@needs_x
def test_window_opens_obeys_keys_and_shows_water(display, tmp_path):
    arguments = (write(tmp_path), "--size", f"{WIDTH}x{HEIGHT}")
    (tmp_path / "alone.py").write_text(ALONE)
    process = play(*arguments, display=display.display, folder=tmp_path, run=("alone.py",))
    try:
        seen = wait_for(process, "ready in")
        assert "pause and resume" in seen and "left drag" in seen
        screen = display
        time.sleep(2.0)
        water = screen.look()
        assert water.std() > 10.0
        # The water is turquoise: blue is well above red somewhere in the middle.
        middle = water[HEIGHT // 4 : 3 * HEIGHT // 4, WIDTH // 3 : 2 * WIDTH // 3]
        assert ((middle[..., 2] - middle[..., 0]) > 25).mean() > 0.05
        screen.send("key", "space")
        paused = screen.still()
        screen.send("key", "h")
        helped = screen.still(unlike=paused, by=5.0)
        screen.send("key", "Escape")
        screen.still(unlike=helped, by=5.0)
        screen.send("key", "v")
        particles = screen.still(unlike=paused, by=2.0)
        screen.do("keydown", "d")
        screen.send("keyup", "d")
        turned = screen.still(unlike=particles, by=1.0)
        screen.do("keydown", "Right")
        screen.send("keyup", "Right")
        tilted = screen.still(unlike=turned, by=1.0)
        screen.send("key", "Return")
        screen.still(unlike=tilted, by=1.0)
        # Drags the slider of gravity, the first in the panel, below the buttons of its pages.
        screen.do("key", "i")
        text = text_height(HEIGHT)
        column = 2 * round(GAP * text) + round(3.5 * LINE * text)
        top = column + (0.5 + (2 + 0.5 + 0.9 + 0.5) * LINE) * text
        screen.move(40, top, "mousedown", 1)
        screen.move(100, top)
        screen.do("mouseup", 1)
        screen.do("key", "k")
        wait_for_file(tmp_path / "out", "small_*.npz")
        scene = wait_for_file(tmp_path / "out", "small_*.scene.toml")
        gravity = read_toml(scene)["gravity"][1]
        assert gravity < 0.0 and abs(gravity + 9.81) > 0.1
        # Pushes in a view of particles and in the view of the water; saves a clip and an image.
        screen.do("key", "i", "i", "space")
        for _ in range(2):
            screen.move(WIDTH // 2, HEIGHT * 2 // 3, "mousedown", 1)
            screen.move(WIDTH // 2 + 60, HEIGHT * 2 // 3)
            screen.do("mouseup", 1)
            screen.do("key", "r")
            screen.do("key", *["v"] * 6)
        screen.send("key", "p", "o", "c")
        wait_for_file(tmp_path / "out", "small_*.png")
        wait_for_file(tmp_path / "out", "small_*.mp4")
        # Selects another scene, here the same one again, in the same window.
        screen.send("key", *["Tab"] * 30)
        wait_for(process, "ready in")
        screen.differs(screen.look(), 0.5)
        screen.send("key", "q")
        assert process.wait(timeout=PATIENCE) == 0
        assert not (tmp_path / "imgui.ini").exists(), "GGUI's settings, which nobody asked for"
    finally:
        process.kill()


@needs_x
def test_a_killed_session_continues_at_the_next_start(display, tmp_path):
    arguments = (write(tmp_path), "--size", f"{WIDTH}x{HEIGHT}")

    def started():
        process = play(*arguments, display=display.display, folder=tmp_path)
        wait_for(process, "ready in")
        return process

    process = started()
    try:
        (file,) = [wait_for_file(tmp_path, "cache/msph/session_*.npz")]
    finally:
        process.kill()
        process.wait()
    since = time_of(file)
    process = started()
    try:
        display.begun_moving()
        display.send("key", "Return")
        wait_for(process, "ready in")
        display.begun_moving()
        display.send("key", "k")
        continued = wait_for_file(tmp_path, "out/small_*.npz")
        assert not file.exists(), "the session has a file of its own"
        display.send("key", "q")
        assert process.wait(timeout=PATIENCE) == 0
    finally:
        process.kill()
    # Without the saved state, the time simulated since the second start would be less than `since`.
    assert since > 2.0 and since < time_of(continued)
    assert not list(tmp_path.glob("cache/msph/session_*"))


@needs_x
def test_input_at_a_window_is_recorded(display, tmp_path):
    arguments = (write(tmp_path), "--size", f"{WIDTH}x{HEIGHT}", "--record-input", "input.jsonl")
    process = play(*arguments, display=display.display, folder=tmp_path)
    try:
        wait_for(process, "ready in")
        display.begun_moving()
        display.do("key", "t")
        display.move(WIDTH // 2, HEIGHT * 2 // 3, "mousedown", 1)
        display.move(WIDTH // 2 + 60, HEIGHT * 2 // 3)
        display.do("mouseup", 1, "key", "j")
        display.send("key", "q")
        assert process.wait(timeout=PATIENCE) == 0
    finally:
        process.kill()
    recording = read(tmp_path / "input.jsonl")
    assert recording.header.quality in QUALITIES
    assert "swirl" in {frame.input.use.tool for frame in recording.frames if frame.input.use}
    assert max(abs(frame.input.tilt[0]) for frame in recording.frames) > 1e-3


@needs_x
@pytest.mark.parametrize("wait", [0.2, 0.8])
def test_ctrl_c_ends_play_without_a_traceback(display, wait):
    said = "init_import_site"
    # Repeated if the signal arrives while Python itself starts, which is slow on a loaded machine.
    for _ in range(5):
        if "init_import_site" in said:
            process = play("still", display=display.display, start_new_session=True)
            time.sleep(wait)
            os.killpg(process.pid, signal.SIGINT)
            said, _ = process.communicate(timeout=PATIENCE)
    assert process.returncode in (-signal.SIGINT, 130) and "Traceback" not in said, said


@needs_x
def test_q_quits_while_kernels_are_compiled(display, tmp_path):
    size, uncached = ("--size", f"{WIDTH}x{HEIGHT}"), {"TI_OFFLINE_CACHE": "0"}
    process = play(write(tmp_path), *size, display=display.display, folder=tmp_path, **uncached)
    try:
        wait_for(process, "quit")
        display.differs(display.look(), 0.01)
        display.send("key", "q")
        said = process.communicate(timeout=PATIENCE)[0]
        assert process.returncode == 0 and "ready in" not in said and "Traceback" not in said
    finally:
        process.kill()


@needs_x
@pytest.mark.parametrize("lost", ["display", "window"])
def test_a_lost_display_ends_play_with_one_line(tmp_path, lost):
    """A lost display or window ends `play` with exit code 1 and one line as its last output.

    Regression: it ended with a message of Xlib, or with a failed C++ assertion and exit code 134.
    """
    with virtual_screen(tmp_path) as (screen, server):
        process = play(write(tmp_path), display=screen.display, folder=tmp_path)
        wait_for(process, "q, escape")
        if lost == "display":
            server.kill()
        else:
            find = ["xdotool", "search", "--name", "M-SPH", "windowclose"]
            subprocess.run(find, env={**os.environ, "DISPLAY": screen.display}, check=True)
        rest = process.communicate(timeout=PATIENCE)[0]
    assert process.returncode == 1
    assert rest.strip().splitlines()[-1] == "msph: the display or the window was lost"
    assert "XIO" not in rest and "RHI" not in rest


def test_a_clip_in_progress_is_completed_when_the_display_is_lost(tmp_path):
    """The file of a clip in progress is complete after the display is lost.

    Regression: the file had no index, and no player opened it.
    """
    import taichi as ti

    from msph.picture.pixels import Image
    from msph.stage import lost_display
    from msph.stage.clip import Clip
    from msph.stage.keepsakes import Saver
    from msph.stage.layout import Layout

    clip, path = Clip(), tmp_path / "clip.mp4"
    image = Image(ti.Vector.field(3, ti.f32, (128, 80)), 128, 80)
    for k in range(4):
        clip.observe(image, 0.1 * k)
    saver = Saver(Layout((640, 360)), clip, "pool", "small")
    saver.clips.append(clip.write(path))
    with lost_display.completing(saver.close):
        for complete in lost_display._completions:
            complete()
    assert imageio.get_reader(path).count_frames() == 7
    assert not lost_display._completions


@needs_x
def test_a_lesson_is_answered_and_done_with_keys_and_mouse(display, tmp_path):
    """Keys answer a question, the mouse completes a task, and the cache holds the progress."""
    size = ("--size", f"{WIDTH}x{HEIGHT}")
    process = play("kernels", *size, display=display.display, command="lesson", folder=tmp_path)
    try:
        question = display.begun()
        display.do("key", "n")
        assert np.array_equal(display.still(), question), "the question comes first"
        display.send("key", "b")
        answered = display.still(unlike=question, by=0.1)
        display.send("key", "n")
        task = display.still(unlike=answered, by=0.1)
        # Drags the first slider, the support, to its lower end in one jump between two frames.
        text = text_height(HEIGHT)
        y = HEIGHT - band_height(text) + (PAD + 0.5 * LINE) * text
        left = CAPTION * WIDTH + NAME * text
        display.move(left + 40, y)
        display.do("mousedown", 1, "mousemove", CORNER + left, CORNER + y, "mouseup", 1)
        display.still(unlike=task, by=1.0)
        display.send("key", "n", "q")
        assert process.wait(timeout=PATIENCE) == 0
    finally:
        process.kill()
    kept = json.loads(next(tmp_path.glob("cache/msph/measured-*.json")).read_text())
    kept = kept["lesson kernels"]
    assert kept["ticked"] == [True, False, False] and kept["answered"] == 2


@pytest.fixture
def no_display(monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)


def test_a_lesson_without_a_display_suggests_a_web_page(no_display):
    run = here("lesson", "kernels")
    assert run.returncode == 2
    assert run.stderr.splitlines()[-1].endswith("--html DIR writes a web page instead")


def test_without_a_display_play_captures_instead(no_display, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(commands, "FALLBACK_SECONDS", 0.2)
    monkeypatch.setattr(commands, "STILL_TIME", 0.2)
    run = here("play", write(tmp_path), "--set", "picture.caustics=false")
    assert run.returncode == 0, run.stderr
    assert run.stderr.splitlines()[0].startswith("no display")
    video, still = tmp_path / "out" / "small.mp4", tmp_path / "out" / "small.png"
    assert "out/small.mp4" in run.stdout and "out/small.png" in run.stdout
    assert video.stat().st_size > 10_000
    assert imageio.imread(still).shape == (720, 1280, 3)
