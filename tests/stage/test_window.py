"""Tests of a real window under Xvfb: images, keys and mouse, in `play` and in lessons."""

import json

import imageio.v2 as imageio
import numpy as np
import pytest

from msph.lesson.paint import CAPTION, LINE, NAME, PAD, band_height
from msph.scene.load import load_scene, read_toml
from msph.stage import commands
from msph.stage.layout import GAP
from msph.stage.sheet import text_height
from tests.command_kit import done, here
from tests.scenes_kit import write
from tests.stage.window_kit import (
    CORNER,
    HEIGHT,
    PATIENCE,
    WIDTH,
    needs_x,
    playing,
    wait_for,
    wait_for_file,
)

# Runs `python -m msph` with the given scene as the only shipped scene.
ALONE = """
import pathlib
import sys
import msph.scene.library as library
library.shipped_scenes = lambda: {sys.argv[2]: pathlib.Path(sys.argv[2])}
import msph.cli
msph.cli.main()
"""


@pytest.mark.slow
@needs_x
def test_window_opens_obeys_keys_and_shows_water(display, tmp_path):
    (tmp_path / "alone.py").write_text(ALONE)
    with playing(display, tmp_path, write(tmp_path), run=("alone.py",)) as process:
        seen = wait_for(process, "ready in")
        assert "pause and resume" in seen and "left drag" in seen
        screen = display
        screen.begun_moving()
        water = screen.look()
        assert water.std() > 10.0
        # The water is turquoise: blue is well above red somewhere in the middle.
        middle = water[HEIGHT // 4 : 3 * HEIGHT // 4, WIDTH // 3 : 2 * WIDTH // 3]
        assert ((middle[..., 2] - middle[..., 0]) > 25).mean() > 0.05
        screen.send("key", "space")
        paused = screen.still()
        helped = screen.after("h", unlike=paused, by=5.0)
        screen.after("Escape", unlike=helped, by=5.0)
        particles = screen.after("v", unlike=paused, by=2.0)
        screen.do("keydown", "d")
        screen.send("keyup", "d")
        turned = screen.still(unlike=particles, by=1.0)
        screen.do("keydown", "Right")
        screen.send("keyup", "Right")
        tilted = screen.still(unlike=turned, by=1.0)
        screen.after("Return", unlike=tilted, by=1.0)
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
        # Pushes the water, and saves a clip and an image.
        screen.do("key", "i", "i", "space")
        screen.move(WIDTH // 2, HEIGHT * 2 // 3, "mousedown", 1)
        screen.move(WIDTH // 2 + 60, HEIGHT * 2 // 3)
        screen.do("mouseup", 1, "key", "r")
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


@pytest.mark.slow
@needs_x
def test_a_lesson_is_answered_and_done_with_keys_and_mouse(display, tmp_path):
    with playing(display, tmp_path, "kernels", command="lesson") as process:
        question = display.begun()
        display.do("key", "n")
        assert np.array_equal(display.still(), question), "the question comes first"
        answered = display.after("b", unlike=question, by=0.1)
        task = display.after("n", unlike=answered, by=0.1)
        # Drags the first slider, the support, to its lower end in one jump between two frames.
        text = text_height(HEIGHT)
        y = HEIGHT - band_height(text) + (PAD + 0.5 * LINE) * text
        left = CAPTION * WIDTH + NAME * text
        display.move(left + 40, y)
        display.do("mousedown", 1, "mousemove", CORNER + left, CORNER + y, "mouseup", 1)
        display.still(unlike=task, by=1.0)
        display.send("key", "n", "q")
        assert process.wait(timeout=PATIENCE) == 0
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
    monkeypatch.setattr(commands, "FALLBACK_SIZE", (WIDTH, HEIGHT))
    monkeypatch.setattr(commands, "STILL_TIME", 0.2)
    run = done("play", write(tmp_path), "--set", "picture.caustics=false")
    assert run.stderr.splitlines()[0].startswith("no display")
    video, still = tmp_path / "out" / "small.mp4", tmp_path / "out" / "small.png"
    assert "out/small.mp4" in run.stdout and "out/small.png" in run.stdout
    assert video.stat().st_size > 10_000
    assert imageio.imread(still).shape == (HEIGHT, WIDTH, 3)
    assert load_scene(tmp_path / "out" / "small.scene.toml").picture.supersample == 1
