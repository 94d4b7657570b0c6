"""Tests of a lesson with a simulation in a window double: keys, mouse, and ignored input."""

import random

import numpy as np
import pytest

from msph.lesson.guide import Guide
from msph.lesson.load import load_lesson
from msph.lesson.paint import band_height
from msph.picture.overlay import Overlay
from msph.stage import idle
from msph.stage.choice import Choice, SceneArguments
from msph.stage.keys import ACTIONS
from msph.stage.layout import Layout
from msph.stage.link import Order
from msph.stage.page import Page
from msph.stage.player import Player
from msph.stage.preparation import named, place, prepare_row
from msph.stage.sheet import Sheet, text_height
from tests.stage.player_kit import HEIGHT, SIZE, WIDTH, Screen, frames, press
from tests.tiers import slow_but


@pytest.fixture(scope="module")
def course():
    return load_lesson("forces")


@pytest.fixture(scope="module")
def row(course):
    return prepare_row(Order(course.scenes), SIZE, band_height(text_height(HEIGHT)))


@pytest.fixture(scope="module")
def layout():
    return Layout(SIZE)


def guided(course, row, layout, folder):
    """Returns a player of a lesson that saves its files in a folder."""
    choice, guide = Choice("forces", "large"), Guide(course, row, SIZE)
    player = Player(Screen(), row, choice, layout, SceneArguments("forces"), guide)
    player.saver.folder = folder
    return player


@pytest.fixture
def player(course, row, layout, tmp_path):
    return guided(course, row, layout, tmp_path)


def test_nothing_moves_while_the_question_is_open(player, row, monkeypatch):
    """Regression: the pool swayed by itself, and the keys that answer turned the camera."""
    monkeypatch.setattr(idle, "IDLE_DELAY", 0.0)
    monkeypatch.setattr(idle, "RAMP_TIME", 1e-3)
    with player.window.holding("a", "Left"):
        frames(player, 3)
        before = row.lead.display.camera.state()
        press(player, "a", number=5)
    assert row.lead.simulation.time == 0.0 and np.allclose(row.lead.pose.tilt, np.eye(3))
    assert row.lead.display.camera.state() == before
    assert player.guide.progress.answered == 1
    press(player, "n", number=4)
    assert row.lead.simulation.time == 0.0, "nor before the user acts in a task"
    press(player, " ", number=4)
    assert row.lead.simulation.time > 0.0
    assert np.allclose(row.lead.pose.tilt, np.eye(3)), "nor does it sway in a task"


@pytest.mark.parametrize("act", ["tilt", "push", "slider"])
def test_a_task_starts_when_the_user_acts(player, row, act):
    press(player, "a", "n", number=3)
    frames(player)
    assert row.lead.simulation.time == 0.0 and player.guide.waits
    window = player.window
    if act == "tilt":
        window.pressed.append("Left")
    else:
        # The cursor moves and the button is pressed between two frames.
        slider = player.guide.page.sheet.widgets[0]
        low = player.guide.below - 0.5 * (slider.top + slider.bottom)
        on_slider = np.array([slider.right, low]) / SIZE
        window.at = on_slider if act == "slider" else np.array([0.5, 0.8])
        window.pressed.append("LMB")
    frames(player, 2)
    assert row.lead.simulation.time > 0.0
    assert (player.guide.progress.values["gravity"] == 20.0) == (act == "slider")
    press(player, "r", number=3)
    assert row.lead.simulation.time == 0.0


def test_reset_of_a_task_levels_the_pool(player, row):
    press(player, "a", "n")
    with player.window.holding("Left"):
        press(player, "Left", number=6)
    assert player.steering.tilt.any()
    press(player, "r")
    assert not player.steering.tilt.any() and row.lead.simulation.time < 0.1
    assert player.wants_more(row) and player.menu.next is None
    press(player, "Tab")
    assert player.menu.next is None, "no other scene is led to"


@pytest.mark.slow
def test_a_pool_of_the_lesson_pressure_stays_tilted_while_its_water_flows(layout, tmp_path):
    """Regression: the pool came level when the key was up, and its water ran to one side while it
    was down, so that the task could not be completed."""
    course = load_lesson("pressure")
    row = prepare_row(Order(course.scenes), SIZE, band_height(text_height(HEIGHT)))
    player = guided(course, row, layout, tmp_path)
    press(player, "c", "n", "n")
    with player.window.holding("Left"):
        press(player, "Left")
        while player.guide.progress.numbers["water"].tilt < 9.0:
            frames(player)
    frames(player, 200)
    assert player.guide.progress.ticked[1], player.guide.shown
    row.close()


def test_a_press_acts_on_one_widget():
    """Regression: a click on a button soon after a drag also moved the slider."""
    size = 100, 100
    page, sheet = Page(Overlay(*size, {"page": size}), "page"), Sheet(size, 18)
    sheet.slider("a", 0.0, (0.0, 1.0), (0.0, 100.0), 0.0)
    sheet.button("b", "b", (0.0, 100.0), 60.0, False)
    page.show("widgets", lambda: sheet, (0, 0))
    assert page.act(np.array([0.5, 0.9]), False, False) is None
    assert page.act(np.array([0.5, 0.3]), True, True) is None
    assert page.act(np.array([0.5, 0.3]), False, False) == ("b", None)


def test_help_covers_the_band_and_messages_are_above_it(player):
    press(player, "a", "n")
    without = frames(player)
    band = slice(0, player.guide.below)
    helped = press(player, "h")
    assert np.abs(helped[:, band] - without[:, band]).mean() > 0.01
    press(player, "h", "l")
    left, low, _, _ = player.layout.overlay.shown["message"]
    assert low >= player.guide.below and left >= 0


def test_preparation_names_each_simulation():
    told = []
    for k, label in enumerate(("System 1: 0.2 kg", "System 2: 0.1 kg")):
        report = named(told.append, place(label, k, 2))
        report("building the scene")
    assert told == [
        "System 1 (1 of 2): building the scene",
        "System 2 (2 of 2): building the scene",
    ]


@pytest.mark.parametrize("seed", slow_but([1], [1, 2]))
def test_random_input_in_a_lesson_loses_no_water(player, row, seed):
    dice, window = random.Random(seed), player.window
    keys = [k for k in ACTIONS if ACTIONS[k] not in ("quit", "clip", "picture")] + ["b", "c"]
    press(player, "a", "n")
    mass = row.lead.ledger.entries[0].mass
    for _ in range(120):
        for _ in range(4):
            kind = dice.randrange(4)
            if kind == 0:
                window.pressed.append(dice.choice(keys))
            elif kind == 1:
                window.held ^= {dice.choice(["LMB", "RMB", "MMB", "Left", "Up", "a", "w"])}
                window.pressed += [b for b in ("LMB", "RMB", "MMB") if b in window.held]
            elif kind == 2:
                window.at = np.array([dice.uniform(-0.3, 1.3), dice.uniform(-0.3, 1.3)])
            else:
                window.at = np.array([dice.uniform(0.6, 1.0), dice.uniform(0.2, 0.38)])
        frames(player)
        progress = player.guide.progress
        assert 0 <= progress.page < progress.pages
        for slider in progress.lesson.slider:
            assert slider.lo <= progress.values[slider.name] <= slider.hi
    assert player.window.image.to_numpy().shape == (WIDTH, HEIGHT, 3)
    entry = row.lead.ledger.record(row.lead.gravity())
    assert entry.mass == pytest.approx(mass, rel=1e-6) and entry.outside == 0
