"""Tests of sessions in a real window that end, are killed, recorded or continued, and of lost
displays."""

import os
import signal
import subprocess
import time

import imageio.v2 as imageio
import pytest
import taichi as ti

from msph.measure.past import time_of
from msph.options import QUALITIES
from msph.stage.recorded_input import read
from tests.scenes_kit import write
from tests.stage.window_kit import (
    HEIGHT,
    PATIENCE,
    WIDTH,
    needs_x,
    play,
    playing,
    virtual_screen,
    wait_for,
    wait_for_file,
)


@pytest.mark.slow
@needs_x
def test_a_killed_session_continues_at_the_next_start(display, tmp_path):
    scene = write(tmp_path)
    with playing(display, tmp_path, scene) as process:
        wait_for(process, "ready in")
        file = wait_for_file(tmp_path, "cache/msph/session_*.npz")
        deadline = time.monotonic() + PATIENCE
        # A slow machine simulates less before its first autosave.
        while time_of(file) <= 2.0 and time.monotonic() < deadline:
            time.sleep(0.5)
    since = time_of(file)
    with playing(display, tmp_path, scene) as process:
        wait_for(process, "ready in")
        display.begun_moving()
        display.send("key", "Return")
        wait_for(process, "ready in")
        display.begun_moving()
        display.send("key", "k")
        continued = wait_for_file(tmp_path, "out/small_*.npz")
        assert not file.exists(), "the session has a file of its own"
        display.send("key", "q")
        assert process.wait(timeout=PATIENCE) == 0
    # Without the saved state, the time simulated since the second start would be less than `since`.
    assert since > 2.0 and since < time_of(continued)
    assert not list(tmp_path.glob("cache/msph/session_*"))


@needs_x
def test_input_at_a_window_is_recorded(display, tmp_path):
    arguments = (write(tmp_path), "--record-input", "input.jsonl")
    with playing(display, tmp_path, *arguments) as process:
        wait_for(process, "ready in")
        display.begun_moving()
        display.do("key", "t")
        display.move(WIDTH // 2, HEIGHT * 2 // 3, "mousedown", 1)
        display.move(WIDTH // 2 + 60, HEIGHT * 2 // 3)
        display.do("mouseup", 1, "key", "j")
        display.send("key", "q")
        assert process.wait(timeout=PATIENCE) == 0
    recording = read(tmp_path / "input.jsonl")
    assert recording.header.quality in QUALITIES
    assert "swirl" in {frame.input.use.tool for frame in recording.frames if frame.input.use}
    assert max(abs(frame.input.tilt[0]) for frame in recording.frames) > 1e-3


@pytest.mark.slow
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


@pytest.mark.slow
@needs_x
def test_q_quits_while_kernels_are_compiled(display, tmp_path):
    uncached = {"TI_OFFLINE_CACHE": "0"}
    with playing(display, tmp_path, write(tmp_path), variables=uncached) as process:
        wait_for(process, "quit")
        display.differs(display.look(), 0.01)
        display.send("key", "q")
        said = process.communicate(timeout=PATIENCE)[0]
        assert process.returncode == 0 and "ready in" not in said and "Traceback" not in said


@pytest.mark.slow
@needs_x
@pytest.mark.parametrize("lost", ["display", "window"])
def test_a_lost_display_ends_play_with_one_line(tmp_path, lost):
    """Regression: `play` ended with a message of Xlib, or with a failed C++ assertion."""
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
    """Regression: the file had no index, and no player opened it."""

    from msph.picture.pixels import Image
    from msph.stage import lost_display
    from msph.stage.keepsakes import Saver
    from msph.stage.layout import Layout

    saver, path = Saver(Layout((640, 360)), "pool", "small"), tmp_path / "clip.mp4"
    image = Image(ti.Vector.field(3, ti.f32, (128, 80)), 128, 80)
    for k in range(4):
        saver.clip.observe(image, 0.1 * k)
    saver.clips.append(saver.clip.write(path))
    with lost_display.completing(saver.close):
        for complete in lost_display._completions:
            complete()
    assert imageio.get_reader(path).count_frames() == 7
    assert not lost_display._completions
