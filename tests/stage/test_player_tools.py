"""Tests of a player's tools: keys and gestures, and their effect on the water."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from msph.fluid.boundary.opening import Opening
from msph.fluid.boundary.rigid_bodies import Ball
from msph.fluid.external_forces import as_vector
from msph.fluid.moving_box import MovingBox
from msph.fluid.simulation import FullError
from msph.launches import watch_compiling
from msph.scene import load_scene
from msph.stage.controls import Controls, ToolUse
from msph.stage.pacer import Pacer
from msph.stage.row import Row
from msph.stage.show import Show
from msph.stage.tools import PRESS_TIME, TOOLS
from msph.stage.touch import Touch
from tests.scenes_kit import POOL, WATER, load
from tests.stage.player_kit import HEIGHT, SIZE, WIDTH, drag, frames, press, wet_pixels, wet_place

DOWN = (0.0, -9.81, 0.0)  # gravity [m/s^2]


# The next two tests run before `show` is built, and use its fields.
def test_a_wall_that_a_body_touches_does_not_move(tmp_path):
    body = "[[bodies]]\nlo = [0, 0, 0.1]\nhi = [0.1, 0.4, 0.3]\n"
    show = Show(load(tmp_path, POOL + WATER + body), 1 / 60)
    use = ToolUse.of("wave", (np.zeros(3),) * 5, 1 / 60, 1 / 60)
    show.frame(Controls(use=use))
    assert "no room" in show.note and show.simulation.piston is None
    show.close()


def test_the_classic_method_refuses_added_bodies_and_openings(tmp_path):
    """Regression: a tap opened, and the water ignored it."""
    show = Show(load(tmp_path), 1 / 60)
    opening = Opening(np.array((0.2, 0.0, 0.2)), np.array((0.0, -1.0, 0.0)), (0.1, 0.1), False)
    with pytest.raises(FullError, match="no inflows"):
        show.simulation.add_opening(opening, DOWN)
    with pytest.raises(FullError, match="no bodies"):
        show.simulation.add_body(Ball(np.array((0.2, 0.3, 0.2)), 0.05, mass=0.1), DOWN)
    show.close()


def test_a_drain_after_a_reset_counts_its_water_once(player, show):
    for _ in range(2):
        show.reset()
        press(player, "z", "z")
        with player.window.holding("LMB", at=wet_place(show)):
            press(player, "LMB", number=4)
        assert show.ledger.entries[-1].outflow_mass > 0.0
        assert abs(show.ledger.mass_change()) < 1e-6
        frames(player)


@pytest.mark.parametrize("key", ["LMB", "r", "z"])
def test_a_press_a_reset_and_another_tool_end_the_last_press(player, show, key, monkeypatch):
    monkeypatch.setattr(Pacer, "frame_time", PRESS_TIME / 8)
    frames(player)
    player.window.at = wet_place(show)
    press(player, "LMB")
    contact = player.steering.contact
    frames(player)
    assert contact.clicked and contact.held == pytest.approx(PRESS_TIME / 4)
    with player.window.holding("LMB"):
        press(player, key)
    assert contact.held == pytest.approx(PRESS_TIME / 8)


def test_a_press_that_waits_for_the_simulation_keeps_its_tool(player, show, monkeypatch):
    frames(player)
    player.window.at = wet_place(show)
    player.window.pressed = ["LMB", "b"]
    monkeypatch.setattr(Row, "busy", True)
    assert player.controls(player.row).use is None and player.steering.tool.name == "ball"
    monkeypatch.setattr(Row, "busy", False)
    assert player.controls(player.row).use.tool == "push"


def test_kernels_for_bodies_compile_once_a_tool_that_adds_them_is_chosen(player, show):
    """Regression: the window stood still for 13 s when the first body was thrown."""
    press(player, "y")
    frames(player, 40)
    assert not show.later
    show.display.shown = show.display.picture.view = None  # the image without water is drawn anew
    show.display.draw()
    before = show.display.picture.to_numpy_u8()
    kernels: list[str] = []
    with watch_compiling(kernels.append):
        show.display.draw_as_with_bodies()
        show.display.draw()
        assert np.array_equal(show.display.picture.to_numpy_u8(), before)
        show.simulation.add_body(Ball(np.array((0.2, 0.33, 0.2)), 0.05, mass=0.1), DOWN)
        show.take()
        show.display.draw()
    assert show.display.shown_bodies == 1
    drawn = "Band", "Surface", "Rounding", "Body", "Shadows", "Backdrop", "Block", "Droplets"
    assert not [name for name in kernels if name.startswith(drawn) and "Links" not in name]


def test_an_interrupted_drawing_leaves_spray_and_mesh_complete(player, show, monkeypatch):
    """A drawing for kernels ends at the first kernel that must be compiled; the next image, also of
    the same water, has a complete mesh, and its spray continues."""
    frames(player)
    display, spray = show.display, show.display.surface.thin.spray
    rounding, before = display.surface.rounding, spray.frame
    display.prepared = False
    with monkeypatch.context() as patch:
        patch.setattr(rounding, "round", lambda bodies: 1 / 0)
        with pytest.raises(ZeroDivisionError):
            display.draw_as_with_bodies()
    assert spray.frame == before and not display.surface.has_bodies and not display.prepared
    rounded = []
    monkeypatch.setattr(rounding, "round", rounded.append)
    for _ in range(2):
        display.draw(new=False)
    assert rounded == [False]


@pytest.mark.parametrize("tool", TOOLS, ids=lambda tool: tool.name)
def test_each_tool_moves_or_adds_water_while_the_button_is_down(player, show, tool):
    player.steering.tool = TOOLS[TOOLS.index(tool) - 1]
    press(player, tool.key, number=2)
    assert player.steering.tool is tool and tool.effect == player.layout.message
    with player.window.holding("LMB", at=wet_place(show)):
        frames(player)
        first = show.ledger.entries[-1]
        drag(player, 0.004, 0.0, 12)
    frames(player)
    last = show.ledger.entries[-1]
    assert (last.user_work != 0.0) == (tool.name not in ("tap", "drain", "wave"))
    assert (last.wall_work > 0.0) == (tool.name == "wave")
    assert (last.inflow_mass > 0.0) == (tool.name == "tap")
    assert (last.outflow_mass > 0.0) == (tool.name == "drain")
    assert (last.added_mass > 0.0) == (tool.name in ("rain", "ball"))
    assert abs(show.ledger.mass_change()) < 1e-6
    # The ball adds water once per press, the rain as long as the button is down.
    assert (last.added_mass > first.added_mass) == (tool.name == "rain")


def test_a_thrown_body_floats_follows_the_cursor_and_is_gone_after_a_reset(player, show):
    player.steering.tool = next(tool for tool in TOOLS if tool.name == "float")
    boundary = show.simulation.boundary
    frames(player)
    show.display.picture.wetness.wet.fill(1.0)
    frames(player)
    wet = show.display.picture.wetness.wet.to_numpy().sum()
    with player.window.holding("LMB", at=wet_place(show)):
        frames(player)
    # Regression: the first body dried all walls.
    assert show.display.picture.wetness.wet.to_numpy().sum() > 0.9 * wet
    frames(player, 20)
    assert boundary.count == 1 and show.display.shown_bodies == 1
    (x,) = boundary.floating.x
    at = show.display.camera.project(x[None], *SIZE, show.simulation.size)[0]
    with player.window.holding("LMB", at=at):
        frames(player)
        drag(player, 0.0, 0.01, 11)
    assert boundary.count == 1 and boundary.floating.x[0, 1] > x[1] + 0.03
    # Regression: pressure in gaps added 0.6 % of the energy to a body dragged along a wall.
    assert abs(show.ledger.mass_change()) < 1e-6 and show.ledger.energy_gain() < 1e-3
    press(player, "r")
    assert boundary.count == 0 and show.display.shown_bodies == 0 and show.tools.touch is None


def test_a_fast_drag_of_an_end_wall_makes_a_wave_and_the_wall_returns(player, show):
    player.steering.tool = next(tool for tool in TOOLS if tool.name == "wave")
    simulation = show.simulation
    frames(player)
    depth = 2.0 * show.ledger.entries[-1].centre[1]
    heights = []

    def observe():
        heights.append(np.percentile(simulation.particles.numpy("x")[:, 1], 98))

    with player.window.holding("LMB", at=wet_place(show)):
        frames(player)
        pushed = player.steering.contact.place + 0.15 * simulation.piston.inwards
        (end,) = show.display.camera.project(pushed[None], *SIZE, simulation.size)
        shift = (end - player.window.at) / 6
        for _ in range(6):
            drag(player, *shift, 1)
            observe()
    place, speed = simulation.piston.at(simulation.time)
    assert place > 0.04 and speed > 0.2
    for _ in range(40):
        frames(player)
        observe()
    assert max(heights) > 1.2 * depth
    assert simulation.piston is None and simulation.boundary.count == 0
    work = max(e.wall_work for e in show.ledger.entries)
    assert abs(show.ledger.mass_change()) < 1e-6 and show.ledger.energy_gain(work) < 0.02
    assert max(e.outside for e in show.ledger.entries) == 0


def test_a_resumed_tap_is_removed_and_replaced_at_the_next_press(player, show, tmp_path):
    """Regression: a tap stayed when its press had ended, and bodies got stuck in its pipe."""
    player.steering.tool = next(tool for tool in TOOLS if tool.name == "tap")
    frames(player)
    with player.window.holding("LMB", at=wet_place(show)):
        frames(player, 4)
    np.savez(tmp_path / "session.npz", **show.simulation.state())
    show.reset()
    show.resume(tmp_path / "session.npz")
    (tap,) = show.simulation.added_openings
    frames(player, 6)
    assert not show.simulation.added_openings
    assert abs(show.ledger.mass_change()) < 1e-6
    with player.window.holding("LMB", at=wet_place(show)):
        frames(player, 2)
    assert len(show.simulation.added_openings) == 1
    assert show.simulation.added_openings != [tap]


def test_a_click_within_a_frame_pushes_the_water_down(player, show):
    frames(player, 2)
    player.window.at, player.window.pressed = wet_place(show), ["LMB"]
    frames(player, 12)
    entries = show.ledger.entries
    # After the push the hand, then at rest, takes energy from the water.
    assert entries[-1].user_impulse[1] < 0.0 < max(e.user_work for e in entries)
    assert not player.steering.contact.holds


def test_the_hand_is_shown_as_a_ball_while_it_pushes(player, show):
    press(player, " ")
    show.now = replace(show.now, ball=None)
    show.draw()
    before = show.display.picture.image.to_numpy()
    centre, radius = np.array(show.simulation.size) / 2, 0.1
    show.now = replace(show.now, ball=(as_vector(centre), radius))
    show.draw()
    changed = np.abs(show.display.picture.image.to_numpy() - before).max(axis=-1) > 1e-3
    right, up, _ = show.display.camera.axes()
    points = np.array([centre, centre + radius * right, centre + radius * up])
    places = show.display.camera.project(points, *SIZE, show.simulation.size) * SIZE
    reach = np.linalg.norm(places[1] - places[0])
    i, j = np.nonzero(changed)
    away = np.hypot(i - places[0, 0], j - places[0, 1])
    assert away.max() == pytest.approx(reach, rel=0.1)
    assert changed.sum() > 0.8 * math.pi * reach**2


def test_pull_lifts_the_water_and_swirl_turns_it(player, show):
    def after(key):
        """Returns the upward impulse [N s], and the mean moment of the velocities near the cursor
        about its vertical axis [m^2/s], after using the tool of a key."""
        show.reset()
        press(player, key, number=2)
        with player.window.holding("LMB", at=wet_place(show)):
            frames(player, 12)
        place = player.steering.contact.place
        frames(player)
        x, v = (show.simulation.particles.numpy(k) for k in "xv")
        r = x - place
        near = np.hypot(r[:, 0], r[:, 2]) < 0.08
        return show.ledger.entries[-1].user_impulse[1], np.cross(r, v)[near, 1].mean()

    lift, turned_by_pull = after("g")
    _, turned = after("t")
    assert lift > 0.0
    assert turned > 5.0 * abs(turned_by_pull)


def test_a_full_pool_refuses_water_with_a_message(player, show, monkeypatch):
    frames(player, 2)
    monkeypatch.setattr(show.simulation.particles, "capacity", show.simulation.particles.count)
    press(player, "b")
    with player.window.holding("LMB", at=wet_place(show)):
        frames(player)
    assert "full" in player.layout.message and show.ledger.mass_change() == 0.0


def test_a_click_on_the_toolbar_selects_a_tool_and_does_not_push_the_water(player, show):
    frames(player, 2)
    left, low, _, height = player.layout.overlay.shown["tools"]
    button = next(b for b in player.layout.pages["tools"].sheet.widgets if b.name == "swirl")
    x, y = 0.5 * (button.left + button.right), 0.5 * (button.top + button.bottom)
    player.window.at = np.array([(left + x) / WIDTH, (low + height - y) / HEIGHT])
    frames(player)
    with player.window.holding("LMB"):
        press(player, "LMB")
    frames(player)
    assert player.steering.tool.name == "swirl"
    assert show.ledger.entries[-1].user_work == 0.0


def test_no_water_is_added_while_paused(player, show):
    press(player, "u", number=2)
    press(player, " ")
    count = show.simulation.particles.count
    with player.window.holding("LMB", at=wet_place(show)):
        frames(player, 20)
    assert show.simulation.particles.count == count


def test_a_drag_pushes_the_water_and_a_cursor_leaves_a_wake(player, show):
    frames(player, 2)
    wet = wet_pixels(show)
    place = np.array(wet[len(wet) // 2][0]) / show.display.picture.size

    def work_of(*held):
        show.reset()
        with player.window.holding(*held, at=place):
            frames(player, 2)
            drag(player, 0.01, 0.0, 6)
        return show.ledger.entries[-1].user_work

    pushed, wake = work_of("LMB"), work_of()
    assert pushed > wake > 0.0 and player.window.marks > 0
    show.scene = show.scene.model_copy(
        update={"play": show.scene.play.model_copy(update={"hover": False})}
    )
    assert work_of() == 0.0


@pytest.mark.parametrize("scene", ["deep", "waves", "pool"])
def test_a_hand_is_narrower_than_the_pool(scene):
    """Regression: its radius was a quarter of the box's longest edge, also of its height."""
    loaded = load_scene(scene)
    finest = SimpleNamespace(spacing=0.0)
    sim = SimpleNamespace(size=loaded.box.size, layers=SimpleNamespace(finest=finest))
    touch = Touch(sim, np.random.default_rng())
    use, box = ToolUse.of("push", (np.zeros(3),) * 5, 1 / 60, 1 / 60), MovingBox(DOWN)
    touch.update(use, loaded.play, box)
    assert touch.radius <= 0.7 * min(loaded.box.size[0], loaded.box.size[2])
