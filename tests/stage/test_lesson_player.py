"""A lesson with water at a window, without a screen: keys, mouse, and what they must not do."""

import random

import numpy as np
import pytest

from msph.lesson.guide import Guide
from msph.lesson.load import load_lesson
from msph.lesson.paint import band_height
from msph.stage import idle
from msph.stage.called import Choice, SceneArguments
from msph.stage.controls import ACTIONS
from msph.stage.layout import Layout
from msph.stage.pages import text_height
from msph.stage.player import Player
from msph.stage.preparation import prepare_row
from tests.stage.test_player import HEIGHT, SIZE, WIDTH, Screen, frames, press


@pytest.fixture(scope="module")
def course():
    return load_lesson("forces")


@pytest.fixture(scope="module")
def row(course):
    return prepare_row(course.scenes, [""], SIZE, None, band_height(text_height(HEIGHT)))


@pytest.fixture(scope="module")
def layout():
    return Layout(SIZE)


@pytest.fixture
def player(course, row, layout, tmp_path):
    choice, guide = Choice("forces", "large"), Guide(course, row, SIZE)
    player = Player(Screen(), row, choice, "large", layout, SceneArguments("forces"), guide=guide)
    player.saver.folder = tmp_path
    return player


def test_nothing_moves_while_the_question_is_open(player, row, monkeypatch):
    """The pool swayed by itself, and the keys that answer turned the view."""
    monkeypatch.setattr(idle, "IDLE_DELAY", 0.0)
    monkeypatch.setattr(idle, "RAMP_TIME", 1e-3)
    player.window.held = {"a", "Left"}
    frames(player, row, 3)
    before = row.lead.camera.state()
    press(player, row, "a", number=5)
    assert row.lead.simulation.time == 0.0 and np.allclose(row.lead.tilt, np.eye(3))
    assert row.lead.camera.state() == before
    assert player.guide.progress.answered == 1
    player.window.held = set()
    press(player, row, "n", number=4)
    assert row.lead.simulation.time > 0.0
    assert np.allclose(row.lead.tilt, np.eye(3)), "nor does it sway in a task"


def test_a_task_begins_again_level(player, row):
    press(player, row, "a", "n")
    player.window.held = {"Left"}
    frames(player, row, 6)
    player.window.held = set()
    assert player.steering.tilt.any()
    press(player, row, "r")
    assert not player.steering.tilt.any() and row.lead.simulation.time < 0.1
    assert player.wants_more(row) and player.menu.next is None
    press(player, row, "Tab")
    assert player.menu.next is None, "no other scene is led to"


def test_help_and_messages_lie_over_the_band(player, row):
    press(player, row, "a", "n")
    without = frames(player, row)
    band = slice(0, player.guide.below)
    helped = press(player, row, "h")
    assert np.abs(helped[:, band] - without[:, band]).mean() > 0.01
    press(player, row, "h", "l")
    left, low, _, _ = player.layout.overlay.shown["message"]
    assert low >= player.guide.below and left >= 0


@pytest.mark.parametrize("seed", [1, 2])
def test_a_storm_of_inputs_loses_no_water(player, row, seed):
    dice, window = random.Random(seed), player.window
    keys = [k for k in ACTIONS if ACTIONS[k] not in ("quit", "clip", "picture")] + ["b", "c"]
    press(player, row, "a", "n")
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
        frames(player, row)
        progress = player.guide.progress
        assert 0 <= progress.page < progress.pages
        for slider in progress.lesson.slider:
            assert slider.lo <= progress.values[slider.name] <= slider.hi
    assert player.window.image.to_numpy().shape == (WIDTH, HEIGHT, 3)
    entry = row.lead.ledger.record(row.lead.gravity())
    assert entry.mass == pytest.approx(mass, rel=1e-6) and entry.outside == 0
