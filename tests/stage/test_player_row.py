"""Tests of a player with simulations side by side."""

import math
from types import SimpleNamespace

import imageio.v2 as imageio
import numpy as np
import pytest

from msph.measure.timings import Timings
from msph.scene.live import with_live_value
from msph.stage.controls import Controls
from msph.stage.layout import Layout
from msph.stage.row import Row, strip_height
from msph.stage.show import INTERACTIVE, Show
from tests.stage.player_kit import (
    FRAME,
    HEIGHT,
    SIZE,
    WIDTH,
    Screen,
    drag,
    frames,
    played,
    press,
    wet_pixels,
)

BELOW = 40
STRIP = strip_height(["one", "two"], HEIGHT)
LOW = BELOW + STRIP


@pytest.fixture(scope="module")
def other(show):
    """Yields the second show: the same scene without adaptation, with only coarser particles."""
    scene = show.scene.model_copy(update={"adaptation": type(show.scene.adaptation)()})
    other = Show(scene, FRAME, SIZE, timings=Timings(keep=5), **INTERACTIVE)
    yield other
    other.close()


@pytest.fixture
def row(given, other):
    other.reset()
    other.display.views.name = "water"
    return Row([given, other], ["one", "two"], (2 * WIDTH + 2, HEIGHT + LOW), BELOW)


@pytest.fixture(scope="module")
def wide():
    return Layout((2 * WIDTH + 2, HEIGHT + LOW))


@pytest.fixture
def player(row, wide, tmp_path):
    """Returns a player of both simulations."""
    screen = Screen()
    screen.size, screen.aspect = row.size, row.size[0] / row.size[1]
    player = played(row, wide, screen=screen)
    player.saver.folder = tmp_path
    return player


def test_both_get_the_same_frames_and_are_rendered_side_by_side(row):
    for _ in range(3):
        row.frame(Controls(tilt=(0.2, 0.0), frame_time=FRAME))
    first, second = row.shows
    assert first.simulation.time == second.simulation.time == pytest.approx(3 * FRAME)
    assert np.array_equal(first.pose.tilt, second.pose.tilt) and first.pose.tilt[0, 1] != 0.0
    pixels = row.image.to_numpy()
    beside = slice(WIDTH + 2, 2 * WIDTH + 2)
    # Above the labels the row contains the rendered images unchanged.
    low = slice(LOW, LOW + HEIGHT)
    assert np.array_equal(pixels[:WIDTH, low], first.display.picture.image.to_numpy())
    assert np.array_equal(pixels[beside, low], second.display.picture.image.to_numpy())
    assert row.to_numpy_u8().shape == (HEIGHT + STRIP, 2 * WIDTH + 2, 3)
    row.frame(Controls(still=True))
    assert first.simulation.time == second.simulation.time == pytest.approx(3 * FRAME)


def test_a_slow_lead_limits_the_time_of_the_other(row):
    """If the budget ends after one step of the lead, the other show advances no farther."""
    row.frame(Controls(frame_time=5 * FRAME, budget=0.0))
    first, second = row.shows
    assert 0.0 < first.simulation.time < 5 * FRAME
    assert second.simulation.time == pytest.approx(first.simulation.time)


def test_the_cursor_selects_the_simulation_under_it(row):
    first, second = row.shows
    for show, left in ((first, 0), (second, WIDTH + 2)):
        cursor = np.array([left + 0.25 * WIDTH, LOW + 0.5 * HEIGHT]) / row.size
        under, place = row.show_under(cursor)
        assert under is show and place == pytest.approx([0.25, 0.5])
        assert row.to_window(show, np.array([[0.25, 0.5]]))[0] == pytest.approx(cursor)


def test_parameters_apply_only_to_simulations_that_have_them(row):
    row.set("gravity", 5.0)
    row.set("classic.stiffness", 100.0)
    for show in row.shows:
        assert math.hypot(*show.scene.gravity) == pytest.approx(5.0)
        assert show.scene.classic.stiffness != 100.0
    row.set("gravity", 9.81)


def test_a_push_in_the_second_image_pushes_both_simulations(row, player, tmp_path):
    screen = player.window
    frames(player, 2)
    wet = wet_pixels(row.shows[1])
    i, j = wet[len(wet) // 2][0]
    screen.at = np.array([WIDTH + 2 + i, LOW + j]) / row.size
    with screen.holding("LMB"):
        frames(player, 2)
        drag(player, 0.005, 0.0, 6)
    assert all(show.ledger.entries[-1].user_work > 0.0 for show in row.shows)
    # Saved images contain both simulations.
    press(player, "p")
    (path,) = tmp_path.glob("*.png")
    assert imageio.imread(path).shape == (HEIGHT + STRIP, 2 * WIDTH + 2, 3)


def test_a_push_stays_in_the_simulation_that_it_began_in(row, player):
    """Regression: the push jumped by a box's width where the cursor entered the next image."""
    screen = player.window
    frames(player, 2)
    first = row.shows[0]
    i, j = max(pixel for pixel, _ in wet_pixels(first))
    screen.at = np.array([i, LOW + j]) / row.size
    screen.held = {"LMB"}
    frames(player, 2)
    speeds = []
    for right in range(i, WIDTH + 60, 6):
        screen.at = np.array([right, LOW + j]) / row.size
        use = player.controls(row).use
        speeds.append(math.hypot(*use.velocity) * player.pacer.frame_time)
    assert max(speeds) < 0.1 * max(first.simulation.size)
    assert row.show_under(screen.at)[0] is row.shows[1]


def test_resetting_a_setting_restores_the_value_of_each_scene(row, player):
    second = row.shows[1]
    second.initial = with_live_value(second.initial, "gravity", 3.0)
    player.menu.set("gravity", 7.0)
    frames(player)
    assert math.hypot(*second.scene.gravity) == pytest.approx(7.0)
    player.menu.set("gravity", None)
    frames(player)
    assert math.hypot(*second.scene.gravity) == pytest.approx(3.0)
    assert math.hypot(*row.lead.scene.gravity) == pytest.approx(9.81)
    row.set("gravity", 9.81)


def test_input_is_answered_between_the_images_of_simulations_elsewhere(row, player):
    """Regression: keys waited until all simulations of another process were drawn, 0.1 s."""
    frames(player)
    row.remote = SimpleNamespace(give=lambda controls: None, busy=False, running=False)
    drawn, screen, second = [], player.window, row.shows[1]
    show = screen.show

    def shown(image):
        drawn.append((player.paused, second.frames))
        show(image)

    screen.show = shown
    controls = player.controls(row)
    screen.pressed = [" "]
    before = second.frames
    row.frame(controls)
    assert drawn == [(True, before)] and second.frames == before + 1


def test_pages_are_removed_from_the_last_image_without_drawing_the_simulations(row):
    row.frame(Controls(frame_time=FRAME))
    without, drawn = row.image.to_numpy(), [show.frames for show in row.shows]
    row.image.field.fill(0.5)
    row.restore()
    assert [show.frames for show in row.shows] == drawn
    # Labels hold times, which change.
    low = slice(LOW, LOW + HEIGHT)
    assert np.array_equal(row.image.to_numpy()[:, low], without[:, low])


def test_checkpoints_require_a_single_simulation(player, tmp_path):
    press(player, "k", "o")
    assert not list(tmp_path.iterdir()) and "need a single simulation" in player.layout.message
