"""A player at a window without a screen: each key and gesture, its effect read from the show."""

import itertools
import math
import random
import re
from dataclasses import replace

import imageio.v2 as imageio
import numpy as np
import pytest

from msph import user_cache
from msph.fluid.boundary.opening import Opening
from msph.fluid.boundary.rigid_bodies import Ball
from msph.fluid.external_forces import as_vector
from msph.fluid.particles.layers import pair_support
from msph.fluid.simulation import FullError
from msph.measure.timings import Timings
from msph.scene import load_scene
from msph.scene.library import shipped_scenes
from msph.scene.live import live_parameters, read, with_live_value
from msph.scene.load import read_toml
from msph.stage import clip, idle, menu
from msph.stage.autosave import About, LostSession
from msph.stage.called import Choice, SceneArguments
from msph.stage.controls import ACTIONS, KEYS, Controls
from msph.stage.layout import PANELS, Layout
from msph.stage.pacer import Pacer
from msph.stage.panel import PAGES, Request
from msph.stage.player import SLOW_MOTION, Player
from msph.stage.row import Row
from msph.stage.show import INTERACTIVE, Show
from msph.stage.tools import BY_NAME, PRESS_TIME, TOOLS, ToolUse
from tests.scenes_kit import TEXT, WATER, write

SIZE = WIDTH, HEIGHT = 480, 270
FRAME = 1 / 60


class Screen:
    """What a window brings: keys and buttons that are pressed or held, and a cursor."""

    def __init__(self):
        self.size, self.open, self.aspect = SIZE, True, WIDTH / HEIGHT
        self.pressed, self.held = [], set()
        self.at, self.marks, self.image = np.array([0.5, 0.4]), 0, None
        self.arrowed = None

    def presses(self):
        pressed, self.pressed = self.pressed, []
        return pressed

    def down(self, *keys):
        return any(key in self.held for key in keys)

    def cursor(self):
        return self.at.copy()

    def mark(self, cursor):
        self.marks += 1

    def arrows(self, places):
        self.arrowed = places

    def show(self, image):
        self.image = image


def at_panel(player, x, y):
    """The cursor at a place of the open panel [pixels from its corner]."""
    layout = player.layout
    top = HEIGHT - layout.column_size[1]
    player.window.at = np.array([x / WIDTH, 1.0 - (top + y) / HEIGHT])


def click(player, show, name):
    """A click on a button of the open panel."""
    button = next(b for b in player.menu.panel.sheet.buttons if b.name == name)
    at_panel(player, 0.5 * (button.left + button.right), 0.5 * (button.top + button.bottom))
    player.window.held, player.window.pressed = {"LMB"}, ["LMB"]
    frames(player, show)
    player.window.held = set()
    frames(player, show, 2)


def move(player, show, key, value):
    """A slider of the open panel, dragged from where it is to a value."""
    slider = next(s for s in player.menu.panel.sheet.sliders if s.name == key)
    y = 0.5 * (slider.top + slider.bottom)
    at_panel(player, slider.left, y)
    player.window.held, player.window.pressed = {"LMB"}, ["LMB"]
    frames(player, show)
    share = (value - slider.lo) / (slider.hi - slider.lo)
    at_panel(player, slider.left + share * (slider.right - slider.left), y)
    frames(player, show, 2)
    player.window.held = set()
    frames(player, show)


@pytest.fixture(scope="module")
def show(tmp_path_factory):
    """Viscous water, so that more parameters are live."""
    path = write(
        tmp_path_factory.mktemp("scene"),
        f"""{TEXT.split("[classic]")[0]}
[projection]
viscosity = 1.0
{WATER}""",
    )
    scene = load_scene(path, ("method=projection", "adaptation.enabled=true"))
    return Show(scene, FRAME, SIZE, timings=Timings(keep=1), **INTERACTIVE)


@pytest.fixture
def given(show):
    """The show at its start, with the scene as it was."""
    scene = show.scene
    show.reset()
    show.display.views.name, show.display.camera = "water", show.display.framing()
    show.display.views.neighbourhood.pick(None)
    show.display.views.cut = None
    yield show
    for live in live_parameters(scene):
        show.set(live.key, read(scene, live.key))
    show.scene = scene


@pytest.fixture(scope="module")
def layout():
    """One for all players, as in a session."""
    return Layout(SIZE)


def played(row, layout, *, screen=None, choice=None, quality="medium"):
    choice = choice or Choice("pool", "auto")
    choice = replace(choice, found=quality)
    return Player(screen or Screen(), row, choice, layout, SceneArguments("pool"))


@pytest.fixture
def player(given, layout, tmp_path):
    player = played(Row([given]), layout)
    player.saver.folder = tmp_path
    return player


def frames(player, _=None, number=1):
    """Frames of a player and its row; the last image, (width, height, 3)."""
    for _ in range(number):
        player.row.frame(player.controls(player.row))
        player.observe(player.row)
    return player.window.image.to_numpy()


def press(player, show, *keys, number=1):
    player.window.pressed += keys
    return frames(player, show, number)


def test_pause_single_step_reset(player, show):
    press(player, show, " ")
    assert show.simulation.time == 0.0
    press(player, show, "n")
    assert show.simulation.time > 0.0
    press(player, show, "r")
    assert show.simulation.time == 0.0
    press(player, show, " ")
    assert show.simulation.time > 0.0


def test_slow_motion_and_back(player, show):
    press(player, show, "m")
    assert player.pacer.speed == SLOW_MOTION
    press(player, show, "m")
    assert player.pacer.speed == 1.0


def come_level(player, show):
    """Frames are as long as this machine needs."""
    for _ in range(600):
        frames(player, show)
        if not player.steering.tilt.any():
            return
    raise AssertionError(f"still tilted by {player.steering.tilt} rad")


def test_arrows_tilt_and_the_pool_comes_level_unless_locked(player, show):
    player.window.held = {"Right"}
    frames(player, show, 10)
    tilt = player.steering.tilt[0]
    assert tilt < -0.02 and show.pose.tilt[0, 1] != 0.0
    player.window.held = set()
    come_level(player, show)
    press(player, show, "l")
    player.window.held = {"Up"}
    frames(player, show, 10)
    player.window.held = set()
    for _ in range(600):
        frames(player, show)
        if abs(player.steering.rate).max() < 1e-3:
            break
    tilt = player.steering.tilt[1]
    frames(player, show, 10)
    assert player.steering.tilt[1] == pytest.approx(tilt, abs=1e-3) and tilt < -0.02
    press(player, show, "Return")
    come_level(player, show)


def test_tilting_turns_the_box_at_the_rate_of_its_tilt(given, monkeypatch):
    """The rates of a frame are those between its tilt and the last one's; a pause and a reset
    begin anew."""
    seen = []
    advance = given.simulation.advance
    monkeypatch.setattr(
        given.simulation,
        "advance",
        lambda t, box, *a: seen.append(box.at(0.0, t)) or advance(t, box, *a),
    )
    for roll in (0.0, 0.01, 0.03):
        azimuth = given.display.camera.azimuth
        given.frame(Controls(tilt=(roll, 0.0), azimuth=azimuth, frame_time=FRAME))
    rates = [np.linalg.norm(e.angular_velocity) for e in seen]
    assert rates == pytest.approx([0.0, 0.01 / FRAME, 0.02 / FRAME])
    rises = [np.linalg.norm(e.angular_acceleration) for e in seen]
    assert rises == pytest.approx([0.0, 0.01 / FRAME**2, 0.01 / FRAME**2])
    # About the camera's view axis.
    back = given.display.camera.axes()[2] * (1.0, 0.0, 1.0)
    along = seen[1].angular_velocity @ back / np.linalg.norm(back)
    assert abs(along) == pytest.approx(rates[1], rel=1e-3)
    given.frame(Controls(tilt=(0.3, 0.0), still=True))
    given.frame(Controls(tilt=(0.3, 0.0), frame_time=FRAME))
    given.frame(Controls(tilt=(0.1, 0.0), frame_time=FRAME, reset=True))
    assert [e.angular_velocity for e in seen[3:]] == [(0.0, 0.0, 0.0)] * 2


def test_a_jolt_tilts_the_pool_to_and_fro_and_ends(player, show):
    press(player, show, "j")
    rolls = []
    for _ in range(100):
        frames(player, show)
        rolls.append(player.steering.jolt)
    assert min(rolls) < -0.05 and max(rolls) > 0.05 and rolls[-1] == 0.0
    assert show.ledger.entries[-1].inertia_work != 0.0


def wet_place(show):
    """A place on the water, (right, up) in shares of the window."""
    pixels = itertools.product(range(0, WIDTH, 4), range(0, HEIGHT, 4))
    wet = [pixel for pixel in pixels if show.display.pick(*pixel) is not None]
    return np.array(wet[len(wet) // 2]) / SIZE


def test_a_drain_after_a_reset_counts_its_water_once(player, show):
    for _ in range(2):
        show.reset()
        press(player, show, "0")
        player.window.at, player.window.held = wet_place(show), {"LMB"}
        press(player, show, "LMB", number=4)
        assert show.ledger.entries[-1].outflow_mass > 0.0
        assert abs(show.ledger.mass_change()) < 1e-6
        player.window.held = set()
        frames(player, show)


@pytest.mark.parametrize("key", ["LMB", "r", "0"])
def test_a_press_a_reset_and_another_tool_end_the_last_press(player, show, key, monkeypatch):
    monkeypatch.setattr(Pacer, "frame_time", PRESS_TIME / 8)
    frames(player, show)
    player.window.at = wet_place(show)
    press(player, show, "LMB")
    contact = player.steering.contact
    frames(player, show)
    assert contact.clicked and contact.held == pytest.approx(PRESS_TIME / 4)
    player.window.held = {"LMB"}
    press(player, show, key)
    assert contact.held == pytest.approx(PRESS_TIME / 8)


@pytest.mark.parametrize("tool", TOOLS, ids=lambda tool: tool.name)
def test_each_tool_moves_or_adds_water_while_the_button_is_down(player, show, tool):
    player.steering.tool = next(t for t in TOOLS if t is not tool)
    press(player, show, tool.key, number=2)
    assert player.steering.tool is tool and tool.effect == player.layout.message
    player.window.at, player.window.held = wet_place(show), {"LMB"}
    frames(player, show)
    first = show.ledger.entries[-1]
    for _ in range(12):
        player.window.at = player.window.at + np.array([0.004, 0.0])
        frames(player, show)
    player.window.held = set()
    frames(player, show)
    last = show.ledger.entries[-1]
    assert (last.user_work != 0.0) == (tool.name not in ("tap", "drain", "wave"))
    assert (last.wall_work > 0.0) == (tool.name == "wave")
    assert (last.inflow_mass > 0.0) == (tool.name == "tap")
    assert (last.outflow_mass > 0.0) == (tool.name == "drain")
    assert (last.added_mass > 0.0) == (tool.name in ("rain", "ball"))
    assert abs(show.ledger.mass_change()) < 1e-6
    # A ball at each press, rain in each frame.
    assert (last.added_mass > first.added_mass) == (tool.name == "rain")


def test_a_thrown_body_floats_follows_the_cursor_and_is_gone_after_a_reset(player, show):
    player.steering.tool = next(tool for tool in TOOLS if tool.name == "float")
    boundary = show.simulation.boundary
    frames(player, show)
    show.display.picture.wetness.wet.fill(1.0)
    frames(player, show)
    wet = show.display.picture.wetness.wet.to_numpy().sum()
    player.window.at, player.window.held = wet_place(show), {"LMB"}
    frames(player, show)
    # The first body dried all walls.
    assert show.display.picture.wetness.wet.to_numpy().sum() > 0.9 * wet
    player.window.held = set()
    frames(player, show, 20)
    assert boundary.count == 1 and show.display.shown_bodies == 1
    (x,) = boundary.floating.x
    at = show.display.camera.project(x[None], *SIZE, show.simulation.size)[0]
    player.window.at, player.window.held = at, {"LMB"}
    for _ in range(12):
        frames(player, show)
        player.window.at = player.window.at + np.array([0.0, 0.01])
    assert boundary.count == 1 and boundary.floating.x[0, 1] > x[1] + 0.03
    assert abs(show.ledger.mass_change()) < 1e-6 and show.ledger.energy_gain() < 1e-3
    player.window.held = set()
    press(player, show, "r")
    assert boundary.count == 0 and show.display.shown_bodies == 0 and show.dragged is None


def test_a_fast_drag_of_an_end_wall_makes_a_wave_and_the_wall_returns(player, show):
    player.steering.tool = next(tool for tool in TOOLS if tool.name == "wave")
    simulation = show.simulation
    frames(player, show)
    depth = 2.0 * show.ledger.entries[-1].centre[1]
    player.window.at, player.window.held = wet_place(show), {"LMB"}
    frames(player, show)
    inwards, heights = simulation.piston.inwards, []
    shift = show.display.camera.project(
        np.array([player.steering.contact.place + 0.15 * inwards]), *SIZE, simulation.size
    )[0] - player.window.at  # fmt: skip
    for _ in range(6):
        player.window.at = player.window.at + shift / 6
        frames(player, show)
        heights.append(np.percentile(simulation.particles.numpy("x")[:, 1], 98))
    place, speed = simulation.piston.at(simulation.time)
    assert place > 0.04 and speed > 0.2
    player.window.held = set()
    for _ in range(40):
        frames(player, show)
        heights.append(np.percentile(simulation.particles.numpy("x")[:, 1], 98))
    assert max(heights) > 1.2 * depth
    assert simulation.piston is None and simulation.boundary.count == 0
    work = max(e.wall_work for e in show.ledger.entries)
    assert abs(show.ledger.mass_change()) < 1e-6 and show.ledger.energy_gain(work) < 0.02
    assert max(e.outside for e in show.ledger.entries) == 0


def test_a_tap_of_a_resumed_session_is_closed_and_goes_with_the_next_press(player, show, tmp_path):
    player.steering.tool = next(tool for tool in TOOLS if tool.name == "tap")
    frames(player, show)
    player.window.at, player.window.held = wet_place(show), {"LMB"}
    frames(player, show, 4)
    np.savez(tmp_path / "session.npz", **show.simulation.state())
    show.reset()
    show.resume(tmp_path / "session.npz")
    (tap,) = show.simulation.added_openings
    player.window.held = set()
    frames(player, show, 4)
    assert show.simulation.openings.speeds[0] == 0.0
    player.window.at, player.window.held = wet_place(show), {"LMB"}
    frames(player, show, 2)
    player.window.held = set()
    assert len(show.simulation.added_openings) == 1
    assert show.simulation.added_openings != [tap]


def test_a_wall_that_a_body_touches_does_not_move(tmp_path):
    body = 'method = "projection"\n[[bodies]]\nlo = [0, 0, 0.1]\nhi = [0.1, 0.4, 0.3]\n'
    text = body.join(TEXT.split("[classic]")[0].split('method = "classic"\n')) + WATER
    show = Show(load_scene(write(tmp_path, text)), 1 / 60)
    use = ToolUse.of(BY_NAME["wave"], (np.zeros(3),) * 5, 1 / 60, 1 / 60)
    show.frame(Controls(use=use))
    assert "no room" in show.note and show.simulation.piston is None
    show.close()


def test_tools_for_bodies_and_openings_say_that_the_classic_method_has_none(tmp_path):
    """A tap opened, and the water ignored it."""
    show = Show(load_scene(write(tmp_path)), 1 / 60)
    opening = Opening(np.array((0.2, 0.0, 0.2)), np.array((0.0, -1.0, 0.0)), (0.1, 0.1), False)
    with pytest.raises(FullError, match="no inflows"):
        show.simulation.add_opening(opening, (0.0, -9.81, 0.0))
    with pytest.raises(FullError, match="no bodies"):
        show.add_body(Ball(np.array((0.2, 0.3, 0.2)), 0.05, mass=0.1))
    show.close()


def test_a_click_within_a_frame_pokes_the_water(player, show):
    frames(player, show, 2)
    player.window.at, player.window.pressed = wet_place(show), ["LMB"]
    frames(player, show, 12)
    entries = show.ledger.entries
    # Afterwards the hand at rest takes energy from the water.
    assert entries[-1].user_impulse[1] < 0.0 < max(e.user_work for e in entries)
    assert not player.steering.contact.holds


def test_the_hand_is_shown_as_a_ball_while_it_pushes(player, show):
    press(player, show, " ")
    show.display.picture.ball = None
    show.display.draw()
    before = show.display.picture.image.to_numpy()
    centre, radius = np.array(show.simulation.size) / 2, 0.1
    show.display.picture.ball = as_vector(centre), radius
    show.display.draw()
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
        """Impulse upwards, and moment of the motion near the cursor about the vertical."""
        show.reset()
        press(player, show, key, number=2)
        player.window.at, player.window.held = wet_place(show), {"LMB"}
        frames(player, show, 12)
        place = player.steering.contact.place
        player.window.held = set()
        frames(player, show)
        x, v = (show.simulation.particles.numpy(k) for k in "xv")
        r = x - place
        near = np.hypot(r[:, 0], r[:, 2]) < 0.08
        return show.ledger.entries[-1].user_impulse[1], np.cross(r, v)[near, 1].mean()

    lift, turned_by_pull = after("g")
    _, turned = after("t")
    assert lift > 0.0
    assert turned > 5.0 * abs(turned_by_pull)


def test_a_full_pool_refuses_water_with_a_message(player, show, monkeypatch):
    frames(player, show, 2)
    monkeypatch.setattr(show.simulation.particles, "capacity", show.simulation.particles.count)
    press(player, show, "b")
    player.window.at, player.window.held = wet_place(show), {"LMB"}
    frames(player, show)
    player.window.held = set()
    assert "full" in player.layout.message and show.ledger.mass_change() == 0.0


def test_a_click_on_the_toolbar_selects_a_tool_and_pushes_nothing(player, show):
    frames(player, show, 2)
    left, low, _, height = player.layout.overlay.shown["tools"]
    button = next(b for b in player.toolbar.sheet.buttons if b.name == "swirl")
    x, y = 0.5 * (button.left + button.right), 0.5 * (button.top + button.bottom)
    player.window.at = np.array([(left + x) / WIDTH, (low + height - y) / HEIGHT])
    frames(player, show)
    player.window.held, player.window.pressed = {"LMB"}, ["LMB"]
    frames(player, show)
    player.window.held = set()
    frames(player, show)
    assert player.steering.tool.name == "swirl"
    assert show.ledger.entries[-1].user_work == 0.0


def test_no_water_is_added_while_paused(player, show):
    press(player, show, "u", number=2)
    press(player, show, " ")
    count = show.simulation.particles.count
    player.window.at, player.window.held = wet_place(show), {"LMB"}
    frames(player, show, 20)
    player.window.held = set()
    assert show.simulation.particles.count == count


def test_camera_orbits_zooms_pans_and_comes_home(player, show):
    home = show.display.camera.state()
    seen = {home}
    for held, moved in (({"d"}, 0.0), ({"s"}, 0.0), ({"RMB"}, 0.1), ({"MMB"}, 0.1)):
        player.window.held = held
        frames(player, show)
        player.window.at = player.window.at + moved
        frames(player, show, 2)
        assert show.display.camera.state() not in seen
        seen.add(show.display.camera.state())
    # A pan by a tenth of the window moves the water by as much.
    player.window.held = set()
    press(player, show, "Return")
    assert show.display.camera.state() == home


def test_a_pan_moves_the_picture_as_far_as_the_cursor(given):
    camera, centre = given.display.camera, np.array(given.simulation.size) / 2

    def seen():
        right, up, back = camera.axes()
        across = 2.0 * math.tan(0.5 * camera.fov) * camera.distance
        away = centre - camera.target
        return np.array([away @ right, away @ up]) / across

    before = seen()
    across = 2.0 * math.tan(0.5 * camera.fov) * camera.distance
    camera.pan(-0.1 * across, 0.0)
    assert seen() - before == pytest.approx([0.1, 0.0], abs=1e-6)
    camera.pan(100.0, 0.0)
    assert np.linalg.norm(camera.target - centre) < camera.distance


def test_a_window_of_another_shape_shows_balls_as_round(player, show):
    """Resized, it stretched the picture."""
    player.window.aspect = 1.0
    player.window.pressed.append("Return")
    show.display.views.name = "speed"
    frames(player, show)
    camera, box = show.display.camera, show.simulation.size
    middle = 0.5 * np.array(box)
    right, up, _ = camera.axes()
    places = camera.project([middle, middle + 0.1 * right, middle + 0.1 * up], WIDTH, HEIGHT, box)
    across, high = places[1, 0] - places[0, 0], places[2, 1] - places[0, 1]
    assert across * player.window.aspect == pytest.approx(high, rel=0.02)
    # And what the cursor meets is what is drawn there.
    i, j = (places[1] * (WIDTH, HEIGHT) - 0.5).tolist()
    eye, direction = camera.box_ray(i, j, WIDTH, HEIGHT, box)
    away = middle + 0.1 * right - eye
    assert np.cross(away, direction) == pytest.approx(np.zeros(3), abs=1e-9)
    shot = show.display.picture.lens.numbers
    away = middle + 0.1 * right - shot["eye"]
    seen = away @ shot["to_i"] / (away @ shot["forward"]) + shot["centre"][0]
    assert (seen + 0.5) / show.display.picture.ray_counts[0] == pytest.approx(
        places[1, 0], abs=1e-6
    )


def test_a_drag_pushes_the_water_and_a_cursor_leaves_a_wake(player, show):
    frames(player, show, 2)
    size = show.display.picture.width, show.display.picture.height
    pixels = itertools.product(range(0, size[0], 4), range(0, size[1], 4))
    wet = [pixel for pixel in pixels if show.display.pick(*pixel) is not None]
    place = np.array(wet[len(wet) // 2]) / size

    def work_of(held):
        show.reset()
        player.window.at, player.window.held = place.copy(), held
        frames(player, show, 2)
        for _ in range(6):
            player.window.at = player.window.at + np.array([0.01, 0.0])
            frames(player, show)
        player.window.held = set()
        return show.ledger.entries[-1].user_work

    pushed, wake = work_of({"LMB"}), work_of(set())
    assert pushed > wake > 0.0 and player.window.marks > 0
    show.scene = show.scene.model_copy(
        update={"play": show.scene.play.model_copy(update={"hover": False})}
    )
    assert work_of(set()) == 0.0


def test_water_that_nobody_touches_moves_until_somebody_does(player, show, monkeypatch):
    def level():
        return np.allclose(show.pose.tilt, np.eye(3), atol=1e-3)

    frames(player, show, 3)
    assert level() and player.idle.hint() == ""
    monkeypatch.setattr(idle, "IDLE_DELAY", 0.0)
    monkeypatch.setattr(idle, "RAMP_TIME", 1e-3)
    # Frames are as long as this machine needs.
    for _ in range(300):
        frames(player, show)
        if not level():
            break
    assert not level() and player.idle.hint() == "drag: push the water"
    player.idle.tried.add("push")
    assert player.idle.hint() == "arrows: tilt"
    monkeypatch.setattr(idle, "IDLE_DELAY", 1e9)
    press(player, show, "l", number=2)
    assert level() and player.idle.hint() == ""


def test_a_scene_that_sways_is_left_to_itself(show):
    sway = show.scene.sway.model_copy(update={"angle": 5.0, "seconds": 4.0})
    swaying = idle.Idle(show.scene.model_copy(update={"sway": sway}), depth=0.1)
    swaying.pass_time(2.0 * idle.IDLE_DELAY, busy=False)
    assert swaying.strength == 1.0
    assert swaying.roll(3.9, 0.1) == 0.0 and swaying.roll(4.1, 0.1) != 0.0
    swaying.pass_time(2.0 * idle.RAMP_TIME, busy=True)
    assert swaying.strength == 0.0


def test_hints_go_once_they_were_tried(player, show):
    everything = frames(player, show, 2)
    low = slice(0, HEIGHT // 5)
    for key in KEYS:
        if key.hint:
            player.idle.tried |= set(key.keys.values())
    nothing = frames(player, show)
    assert "hints" not in player.layout.overlay.shown
    assert np.abs(everything[: WIDTH // 2, low] - nothing[: WIDTH // 2, low]).mean() > 0.01


def test_help_lies_over_the_picture_until_it_is_closed(player, show):
    player.idle.tried |= set(ACTIONS.values())
    press(player, show, " ")
    without = frames(player, show)
    assert np.abs(press(player, show, "h") - without).mean() > 0.05
    # Pages are laid over, and not into, what is drawn: the same picture again.
    assert np.abs(press(player, show, "Escape") - without).mean() < 1e-3
    assert player.wants_more(player.row)
    press(player, show, "q")
    assert not player.wants_more(player.row)


def test_panels_make_room_for_themselves(player, show):
    shifts = []
    for _ in PANELS:
        press(player, show, "i")
        shifts.append(show.display.camera.shift)
    assert shifts[0] == shifts[1] > 0.1 and shifts[2] == 0.0
    assert show.display.camera.state() == show.display.framing().state()
    # The middle of the box is in the middle of what is free.
    press(player, show, "i")
    size, box = (WIDTH, HEIGHT), np.array(show.simulation.size)
    middle = (0.5 + show.display.camera.shift) * WIDTH
    eye, direction = show.display.camera.ray(middle - 0.5, HEIGHT / 2 - 0.5, *size)
    away = box / 2 - eye
    assert np.cross(away, direction) == pytest.approx(np.zeros(3), abs=1e-9)


def test_numbers_of_the_status_are_those_of_positions_and_surface(player, show, monkeypatch):
    frames(player, show, 3)
    # The water is too thin to measure it.
    assert "density" not in player.layout.status._water(show)
    monkeypatch.setattr(show, "bulk_density_error", lambda: 0.0123)
    told = player.layout.status._water(show)
    assert told.startswith("bulk density error +1.23 %")
    volume = show.display.surface.mesh.volume() / show.rest_volume() - 1.0
    assert told.endswith(f"volume error {round(100.0 * volume, 1) + 0.0:+.1f} %")
    # Views of particles extract no surface, so there is no volume of now.
    show.display.views.name = "speed"
    frames(player, show)
    assert "volume" not in player.layout.status._water(show)


def test_pages_are_painted_where_they_change(player, show, monkeypatch):
    """A message was painted in every frame, and so were the facts of a particle."""
    monkeypatch.setattr("msph.stage.layout.EVERY", 60.0)
    monkeypatch.setattr("msph.stage.layout.MESSAGE_TIME", 60.0)
    painted = []
    put = player.layout.overlay.put
    monkeypatch.setattr(player.layout.overlay, "put", lambda *a: (painted.append(a[0]), put(*a)))
    show.display.views.name = "speed"
    frames(player, show)
    show.display.views.neighbourhood.pick(0)
    press(player, show, "l", number=6)
    assert painted.count("message") == painted.count("particle") == 1


def test_graphs_are_drawn_of_what_was_measured(player, show):
    press(player, show, "i", "i")
    before = frames(player, show)
    for k in range(12):
        player.layout.graphs.observe(show, player.layout.graphs.times[-1] + 0.25 * k + 0.2, 1.0)
    page = player.layout.graphs.paint(show, 200, 200, 12)
    assert page.shape == (200, 200, 4) and (page[..., :3].max(-1) > 150).mean() > 0.02
    assert player.layout.overlay.shown["graphs"][0] == 0 and before.std() > 0.05
    assert len(player.layout.graphs.samples[-1][-1]) == len(show.scene.layers)


def test_sliders_change_what_runs_and_never_push(player, show):
    press(player, show, "i")
    wanted = {
        "water": {"gravity": 3.0, "projection.viscosity": 5.0},
        "light": {"picture.tint": 9.0},
        "play": {"play.speed": 0.5, "play.scale": 0.6},
    }
    for page, values in wanted.items():
        click(player, show, f"page {page}")
        assert set(values) <= {s.name for s in player.menu.panel.sheet.sliders}
        for key, value in values.items():
            move(player, show, key, value)
            assert read(show.scene, key) == pytest.approx(value, rel=1e-4)
    assert show.ledger.entries[-1].user_work == 0.0
    assert player.pacer.speed == pytest.approx(0.5) and player.pacer.finest == pytest.approx(0.6)
    viscosity = show.simulation.solver.forces[-1]
    assert viscosity.nu == pytest.approx(5.0 / 1000.0)
    assert show.display.picture.lens.numbers["absorption"][0] == pytest.approx(9.0 * 0.42)
    assert math.hypot(*show.gravity()) == pytest.approx(3.0)
    click(player, show, "page water")
    click(player, show, "reset")
    assert read(show.scene, "gravity") == pytest.approx(9.81)
    assert viscosity.nu == pytest.approx(1.0 / 1000.0)
    assert read(show.scene, "picture.tint") == pytest.approx(9.0), "of another page"


def test_the_panel_is_readable_and_painted_where_it_changes(player, show):
    press(player, show, "i")
    column = player.layout.column
    before = player.window.image.to_numpy()[:column]
    assert player.menu.panel.paint(show, player.layout.column_size, player.layout.text) is None
    press(player, show, " ")
    move(player, show, "gravity", 3.0)
    after = player.window.image.to_numpy()[:column]
    assert np.abs(after - before).max() > 0.3
    # All that a scene has fits in a window of 960 x 540, with text of 18 pixels.
    height = 540 - 2 * 9 - round(2.5 * 1.35 * 18)
    for name in PAGES:
        player.menu.panel.page = name
        player.menu.panel.paint(show, (288, height), 18)
        low = [
            w.bottom for w in (*player.menu.panel.sheet.sliders, *player.menu.panel.sheet.buttons)
        ]
        assert max(low) <= height


def test_a_drag_that_begins_elsewhere_moves_no_slider(player, show):
    press(player, show, "i")
    slider = player.menu.panel.sheet.sliders[0]
    player.window.at = np.array([0.9, 0.9])
    player.window.held, player.window.pressed = {"LMB"}, ["LMB"]
    frames(player, show)
    at_panel(player, slider.right, 0.5 * (slider.top + slider.bottom))
    frames(player, show, 2)
    assert read(show.scene, slider.name) == pytest.approx(read(show.initial, slider.name))
    player.window.held = set()
    frames(player, show)


def test_views_scenes_and_qualities_are_chosen_in_the_panel(player, show):
    press(player, show, "i")
    click(player, show, "page views")
    click(player, show, "view speed")
    assert show.display.views.name == "speed"
    player.menu.set("gravity", 2.0)
    click(player, show, "page quality")
    click(player, show, "quality large")
    assert player.menu.next == Choice("pool", "large", {"gravity": pytest.approx(2.0)})
    player.menu.next = None
    click(player, show, "page scenes")
    click(player, show, "scene drop")
    assert player.menu.next == Choice("drop", "auto")


def test_keys_move_the_selection_and_the_last_one_follows(player, show, monkeypatch):
    names = list(shipped_scenes())
    press(player, show, *["Tab"] * 2)
    press(player, show, *["BackSpace"] * 3)
    here = names.index("pool") - 1
    assert player.menu.next.scene == names[here] and player.wants_more(player.row)
    monkeypatch.setattr(menu, "SETTLED", -1.0)
    assert not player.wants_more(player.row) and player.next_choice.scene == names[here]
    player.done = True
    assert player.next_choice is None, "quitting goes before"


def test_a_live_value_chosen_before_is_taken_over(given, layout):
    frames(played(Row([given]), layout, choice=Choice("pool", "small", {"gravity": 4.0})))
    assert read(given.scene, "gravity") == pytest.approx(4.0)


def test_a_picture_has_no_pages_and_its_scene_beside_it(player, show, tmp_path):
    press(player, show, " ")
    show.set("gravity", 5.0)
    press(player, show, "p")
    (path,) = tmp_path.glob("pool_*.png")
    picture = imageio.imread(path)
    assert picture.shape == (HEIGHT, WIDTH, 3)
    show.display.draw()
    assert np.array_equal(picture, show.display.picture.to_numpy_u8())
    assert str(path) in player.layout.message
    scene = read_toml(path.with_suffix(".scene.toml"))
    assert scene["gravity"][1] == pytest.approx(-5.0)


def test_a_slice_hides_the_near_half_and_follows_the_camera(player, show):
    show.display.views.name = "speed"
    press(player, show, " ")
    whole = show.display.views.radius.to_numpy()[: show.simulation.particles.count]
    assert (whole > 0.0).all()
    x = show.simulation.particles.numpy("x") - 0.5 * np.array(show.simulation.size)
    press(player, show, "x")
    for _ in range(2):
        back = show.display.camera.axes()[2] * (1.0, 0.0, 1.0)
        near = x @ (back / np.linalg.norm(back)) > 1e-5
        hidden = show.display.views.radius.to_numpy()[: len(x)] == 0.0
        assert 0.3 < hidden.mean() < 0.7 and (hidden == near).mean() > 0.99
        show.display.camera.orbit(1.0, 0.0)
        frames(player, show)
    press(player, show, "x")
    assert (show.display.views.radius.to_numpy()[: len(x)] > 0.0).all()


def test_a_click_on_a_particle_shows_its_neighbours_and_what_acts(player, show, monkeypatch):
    # However long this machine takes for a frame.
    monkeypatch.setattr("msph.stage.steering.CLICK_TIME", 60.0)
    show.display.views.name, about = "speed", show.display.views.neighbourhood
    frames(player, show, 3)
    player.window.at = np.array([0.5, 0.45])
    frames(player, show, 2)
    player.window.held, player.window.pressed = {"LMB"}, ["LMB"]
    press(player, show, " ")
    player.window.held = set()
    frames(player, show)
    assert about.id is not None and "particle" in player.layout.overlay.shown
    # Weights by hand: M5 of support h vanishes there, and is 1 at no distance.
    sim = show.simulation
    x, layer = sim.particles.numpy("x").astype(float), sim.particles.numpy("layer")
    specs = sim.layers.specs
    h = np.array([pair_support(specs[layer[about.index]].support, specs[k].support) for k in layer])
    q = np.linalg.norm(x - x[about.index], axis=1) / h

    def shape(q):
        parts = ((1.0, 1.0), (-5.0, 0.6), (10.0, 0.2))
        return sum(c * np.maximum(a - q, 0.0) ** 4 for c, a in parts)

    found = show.display.views.value.to_numpy()[: len(x)]
    assert found == pytest.approx(shape(q) / shape(0.0), abs=1e-5)
    assert f"{(q < 1.0).sum() - 1} neighbours" in about.facts()[0]
    radius = show.display.views.radius.to_numpy()[: len(x)]
    assert radius[q > 1.001].max() < radius[q < 0.999].min()
    # Its density is summed where the particles are, and not what the last step left.
    sim.particles.fields["density"].fill(0.0)
    (told,) = re.findall(r"density ([+-][0-9.]+) %", about.facts()[1])
    sim.measure_density()
    (place,) = np.flatnonzero(sim.particles.numpy("id") == about.id)
    density = sim.particles.numpy("density")[place]
    assert float(told) == pytest.approx(100.0 * (density / 1000.0 - 1.0), abs=0.006)
    # Water at rest bears what gravity pulls.
    press(player, show, " ")
    frames(player, show, 30)
    acting = about.arrows(np.array([0.0, -9.81, 0.0]))
    assert acting["water"][1] == pytest.approx(-acting["gravity"][1], rel=0.3)
    begin, end = player.window.arrowed[0]
    assert end[1] < begin[1] and np.all((begin > 0.0) & (begin < 1.0))
    press(player, show, "v")
    assert about.id is None


def test_water_that_was_kept_is_opened_again(player, show, tmp_path):
    frames(player, show, 3)
    press(player, show, "o")
    assert "no checkpoint of pool" in player.layout.message
    np.savez(tmp_path / "pool_of_another_quality.npz", fluid=np.zeros(5))
    press(player, show, " ", "k")
    (tmp_path / "pool_of_another_quality.npz").touch()
    kept = show.simulation.state()
    press(player, show, " ", number=4)
    press(player, show, " ", "o")
    again = show.simulation.state()
    order, order_again = np.argsort(kept["id"]), np.argsort(again["id"])
    assert np.array_equal(kept["x"][order], again["x"][order_again])
    assert again["time"] == kept["time"]


def test_a_clip_shows_what_was_seen_while_the_simulation_goes_on(
    player, show, tmp_path, monkeypatch
):
    """Images were rendered again, which stopped the simulation for 12 s."""
    monkeypatch.setattr(clip, "FPS", 1000.0)
    frames(player, show, 4)
    show.display.views.name = "speed"
    frames(player, show, 4)
    monkeypatch.setattr(clip, "FPS", 24.0)
    # As if the images had been seen over a third of a second.
    stored = [image for _, image in player.clip.frames]
    assert len(stored) == 8
    player.clip.frames.clear()
    player.clip.frames.extend((k / 24.0, image) for k, image in enumerate(stored))
    before = show.simulation.time
    press(player, show, "c")
    assert show.simulation.time > before and "writing" in player.layout.message
    player.close()
    (path,) = tmp_path.glob("*.mp4")
    seen = [frame for frame in imageio.get_reader(path)]
    assert len(seen) == 7 and seen[0].shape == (HEIGHT, WIDTH, 3)
    assert np.abs(seen[0].astype(int) - seen[-1]).mean() > 1.0


def test_memory_of_the_clip_is_bounded(player, show, monkeypatch):
    monkeypatch.setattr(clip, "FPS", 1e6)
    frames(player, show)
    (size,) = (len(image.result()) for _, image in player.clip.frames)
    monkeypatch.setattr(clip, "MOST_BYTES", 3.5 * size)
    for _ in range(8):
        frames(player, show)
        player.clip.frames[-1][1].result()
    assert len(player.clip.frames) <= 4
    # One image may be more than there is room for.
    monkeypatch.setattr(clip, "MOST_BYTES", 0.5 * size)
    frames(player, show)
    assert len(player.clip.frames) == 1


def test_what_cannot_be_written_is_said(player, show, tmp_path):
    (tmp_path / "file").touch()
    player.saver.folder = tmp_path / "file"
    for key in ("p", "c", "k"):
        frames(player, show, 2)
        press(player, show, key)
        assert "file" in player.layout.message


def test_a_lost_session_is_offered_until_a_key_answers(player, show, tmp_path, monkeypatch):
    monkeypatch.setattr(user_cache, "file", lambda: tmp_path / "cache" / "measured.json")
    file = tmp_path / "cache" / "session_gone_1.npz"
    file.parent.mkdir()
    file.touch()
    about = About("0", "14:32", "drop", "small", (), {"gravity": 3.0})
    player.offer = LostSession(file, about)
    frames(player, show)
    assert player.layout.message == "Enter continues drop of 14:32, any other key deletes it"
    # The mouse answers nothing, and the offer comes back after another message.
    press(player, show, "LMB")
    player.layout.until = 0.0
    frames(player, show)
    assert player.offer and player.layout.message.startswith("Enter")
    press(player, show, "Return")
    assert player.next_choice == Choice("drop", "small", {"gravity": 3.0}, resume=file)
    assert not player.wants_more(player.row) and file.exists()
    player.menu.next, player.offer = None, LostSession(file, about)
    press(player, show, "v")
    assert player.offer is None and not file.exists() and player.wants_more(player.row)


@pytest.mark.parametrize("seed", [1, 2])
def test_a_storm_of_inputs_loses_no_water(player, show, seed):
    """A thousand random inputs: whatever is pressed, dragged, slid and chosen."""
    dice = random.Random(seed)
    mass = show.ledger.record(show.gravity()).mass
    names = [k for k in ACTIONS if ACTIONS[k] not in ("quit", "clip", "keep", "reopen", "picture")]
    window, limits = player.window, {}
    for _ in range(250):
        for _ in range(4):
            kind = dice.randrange(5)
            if kind == 0:
                window.pressed.append(dice.choice(names))
            elif kind == 1:
                window.held ^= {dice.choice(names)}
            elif kind == 2:
                window.at = np.array([dice.uniform(-0.3, 1.3), dice.uniform(-0.3, 1.3)])
            elif kind == 3:
                live = dice.choice(player.menu.panel.live)
                limits[live.key] = dice.uniform(live.lo, live.hi)
                player.menu.apply(Request("set", live.key, limits[live.key]))
            else:
                window.held.clear()
        frames(player, show)
        player.menu.next, player.helping = None, False
    entry = show.ledger.record(show.gravity())
    assert entry.mass == pytest.approx(mass, rel=1e-6) and entry.outside == 0
    assert np.isfinite(show.simulation.particles.numpy("v")).all()


BELOW = 40


@pytest.fixture(scope="module")
def other(show):
    """The water beside: coarser particles alone."""
    scene = show.scene.model_copy(update={"adaptation": type(show.scene.adaptation)()})
    return Show(scene, FRAME, SIZE, timings=Timings(keep=5), **INTERACTIVE)


@pytest.fixture
def row(given, other):
    other.reset()
    other.display.views.name = "water"
    return Row([given, other], ["one", "two"], (2 * WIDTH + 2, HEIGHT + BELOW), BELOW)


@pytest.fixture(scope="module")
def wide():
    return Layout((2 * WIDTH + 2, HEIGHT + BELOW))


class TestRow:
    """Two waters side by side under the same hands."""

    def test_both_get_the_same_frames_and_are_drawn_beside_each_other(self, row):
        for _ in range(3):
            row.frame(Controls(tilt=(0.2, 0.0), frame_time=FRAME))
        first, second = row.shows
        assert first.simulation.time == second.simulation.time == pytest.approx(3 * FRAME)
        assert np.array_equal(first.pose.tilt, second.pose.tilt) and first.pose.tilt[0, 1] != 0.0
        pixels = row.image.to_numpy()
        beside = slice(WIDTH + 2, 2 * WIDTH + 2)
        # Below the names the pictures are as they were drawn.
        low = slice(BELOW, BELOW + HEIGHT // 2)
        assert np.array_equal(
            pixels[:WIDTH, low], first.display.picture.image.to_numpy()[:, : HEIGHT // 2]
        )
        assert np.array_equal(
            pixels[beside, low], second.display.picture.image.to_numpy()[:, : HEIGHT // 2]
        )
        assert row.to_numpy_u8().shape == (HEIGHT, 2 * WIDTH + 2, 3)
        row.frame(Controls(still=True))
        assert first.simulation.time == second.simulation.time == pytest.approx(3 * FRAME)

    def test_a_slower_lead_holds_the_other_back(self, row):
        """A budget that ends after one step of the first: the other goes no farther."""
        row.frame(Controls(frame_time=5 * FRAME, budget=0.0))
        first, second = row.shows
        assert 0.0 < first.simulation.time < 5 * FRAME
        assert second.simulation.time == pytest.approx(first.simulation.time)

    def test_the_cursor_meets_the_water_that_it_is_over(self, row):
        first, second = row.shows
        for show, left in ((first, 0), (second, WIDTH + 2)):
            cursor = np.array([left + 0.25 * WIDTH, BELOW + 0.5 * HEIGHT]) / row.size
            under, place = row.show_under(cursor)
            assert under is show and place == pytest.approx([0.25, 0.5])
            assert row.to_window(show, np.array([[0.25, 0.5]]))[0] == pytest.approx(cursor)

    def test_parameters_reach_those_that_have_them(self, row):
        row.set("gravity", 5.0)
        row.set("classic.stiffness", 100.0)
        for show in row.shows:
            assert math.hypot(*show.scene.gravity) == pytest.approx(5.0)
            assert show.scene.classic.stiffness != 100.0
        row.set("gravity", 9.81)

    def test_a_push_in_the_second_pushes_both(self, row, wide, tmp_path):
        screen = Screen()
        screen.size, screen.aspect = row.size, row.size[0] / row.size[1]
        player = played(row, wide, screen=screen)
        player.saver.folder = tmp_path
        frames(player, row, 2)
        pixels = itertools.product(range(0, WIDTH, 4), range(0, HEIGHT, 4))
        second = row.shows[1]
        wet = [pixel for pixel in pixels if second.display.pick(*pixel) is not None]
        i, j = wet[len(wet) // 2]
        screen.at = np.array([WIDTH + 2 + i, BELOW + j]) / row.size
        screen.held = {"LMB"}
        frames(player, row, 2)
        for _ in range(6):
            screen.at = screen.at + np.array([0.005, 0.0])
            frames(player, row)
        assert all(show.ledger.entries[-1].user_work > 0.0 for show in row.shows)
        screen.held = set()
        # Pictures are of both.
        press(player, row, "p")
        (path,) = tmp_path.glob("*.png")
        assert imageio.imread(path).shape == (HEIGHT, 2 * WIDTH + 2, 3)

    def test_a_push_stays_in_the_simulation_that_it_began_in(self, row, wide):
        """It jumped by a box's width where the cursor came into the next picture."""
        screen = Screen()
        screen.size, screen.aspect = row.size, row.size[0] / row.size[1]
        player = played(row, wide, screen=screen)
        frames(player, row, 2)
        first = row.shows[0]
        wet = [(i, j) for i in range(0, WIDTH, 4) for j in range(0, HEIGHT, 4)]
        i, j = max(pixel for pixel in wet if first.display.pick(*pixel) is not None)
        screen.at = np.array([i, BELOW + j]) / row.size
        screen.held = {"LMB"}
        frames(player, row, 2)
        speeds = []
        for right in range(i, WIDTH + 60, 6):
            screen.at = np.array([right, BELOW + j]) / row.size
            use = player.controls(row).use
            speeds.append(math.hypot(*use.velocity) * player.pacer.frame_time)
        assert max(speeds) < 0.1 * max(first.simulation.size)
        assert row.show_under(screen.at)[0] is row.shows[1]

    def test_settings_go_back_to_what_each_scene_says(self, row, wide):
        second = row.shows[1]
        player = played(row, wide)
        second.initial = with_live_value(second.initial, "gravity", 3.0)
        player.menu.apply(Request("set", "gravity", 7.0))
        frames(player)
        assert math.hypot(*second.scene.gravity) == pytest.approx(7.0)
        player.menu.apply(Request("reset", "gravity"))
        frames(player)
        assert math.hypot(*second.scene.gravity) == pytest.approx(3.0)
        assert math.hypot(*row.lead.scene.gravity) == pytest.approx(9.81)
        row.set("gravity", 9.81)

    def test_one_of_several_is_neither_kept_nor_opened(self, row, wide, tmp_path):
        screen = Screen()
        screen.size = row.size
        player = played(row, wide, screen=screen)
        player.saver.folder = tmp_path
        press(player, row, "k", "o")
        assert not list(tmp_path.iterdir()) and "need a single simulation" in player.layout.message


def test_a_scene_that_is_left_comes_back_as_it_was_called():
    """The scene chosen last was played under its name."""
    called = SceneArguments("pool", ("title=called",), ("'title=with spaces'",))
    titles = {label: scene.title for label, scene in called.scenes_of("pool").items()}
    assert titles == {"title=called": "called", "'title=with spaces'": "with spaces"}
    assert {s.title for s in called.scenes_of("drop").values()} == {load_scene("drop").title}
