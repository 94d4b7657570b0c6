"""Tests of a player: effects of keys and gestures on time, tilt, camera and saved files."""

import math
import random
import time

import imageio.v2 as imageio
import numpy as np
import pytest

from msph.scene import load_scene
from msph.stage import idle, keepsakes
from msph.stage.choice import Choice, SceneArguments
from msph.stage.controls import Controls
from msph.stage.keys import ACTIONS
from msph.stage.player import SLOW_MOTION
from tests.fluid.fluid_kit import in_order
from tests.stage.player_kit import FRAME, HEIGHT, WIDTH, drag, frames, press


def test_pause_single_step_reset(player, show):
    press(player, " ")
    assert show.simulation.time == 0.0
    press(player, "n")
    assert show.simulation.time > 0.0
    press(player, "r")
    assert show.simulation.time == 0.0
    press(player, " ")
    assert show.simulation.time > 0.0


def test_slow_motion_and_back(player):
    press(player, "m")
    assert player.pacer.speed == SLOW_MOTION
    press(player, "m")
    assert player.pacer.speed == 1.0


def come_level(player):
    """Runs frames, whose length depends on the machine, until the pool is level."""
    for _ in range(600):
        frames(player)
        if not player.steering.tilt.any():
            return
    raise AssertionError(f"still tilted by {player.steering.tilt} rad")


def test_arrows_tilt_and_the_pool_comes_level_unless_locked(player, show):
    with player.window.holding("Right"):
        frames(player, 10)
    assert player.steering.tilt[0] < -0.02 and show.pose.tilt[0, 1] != 0.0
    come_level(player)
    press(player, "l")
    with player.window.holding("Up"):
        frames(player, 10)
    for _ in range(600):
        frames(player)
        if abs(player.steering.rate).max() < 1e-3:
            break
    tilt = player.steering.tilt[1]
    frames(player, 10)
    assert player.steering.tilt[1] == pytest.approx(tilt, abs=1e-3) and tilt < -0.02
    press(player, "Return")
    come_level(player)


def test_tilting_turns_the_box_at_the_rate_of_its_tilt(given, monkeypatch):
    """The box turns in a frame at the rate between its tilt and the tilt of the last frame; a pause
    and a reset restart at rate 0."""
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
    # The box turns about the camera's view axis.
    back = given.display.camera.axes()[2] * (1.0, 0.0, 1.0)
    along = seen[1].angular_velocity @ back / np.linalg.norm(back)
    assert abs(along) == pytest.approx(rates[1], rel=1e-3)
    given.frame(Controls(tilt=(0.3, 0.0), still=True))
    given.frame(Controls(tilt=(0.3, 0.0), frame_time=FRAME))
    given.frame(Controls(tilt=(0.1, 0.0), frame_time=FRAME, reset=True))
    assert [e.angular_velocity for e in seen[3:]] == [(0.0, 0.0, 0.0)] * 2


def test_a_jolt_tilts_the_pool_to_and_fro_and_ends(player, show):
    press(player, "j")
    rolls = []
    for _ in range(100):
        frames(player)
        rolls.append(player.steering.jolt)
    assert min(rolls) < -0.05 and max(rolls) > 0.05 and rolls[-1] == 0.0
    assert show.ledger.entries[-1].inertia_work != 0.0


def test_camera_orbits_zooms_pans_and_comes_home(player, show):
    home = show.display.camera.state()
    seen = {home}
    for key, moved in (("d", 0.0), ("s", 0.0), ("RMB", 0.1), ("MMB", 0.1)):
        with player.window.holding(key):
            frames(player)
            drag(player, moved, moved, 1)
            frames(player)
        assert show.display.camera.state() not in seen
        seen.add(show.display.camera.state())
    # The key Return restores the scene's camera.
    press(player, "Return")
    assert show.display.camera.state() == home


def test_a_pan_moves_the_image_as_far_as_the_cursor(given):
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


def test_a_resized_window_shows_balls_as_round(player, show):
    """Regression: a resized window stretched the image."""
    player.window.aspect = 1.0
    player.window.pressed.append("Return")
    show.display.views.name = "speed"
    frames(player)
    camera, box = show.display.camera, show.simulation.size
    middle = 0.5 * np.array(box)
    right, up, _ = camera.axes()
    places = camera.project([middle, middle + 0.1 * right, middle + 0.1 * up], WIDTH, HEIGHT, box)
    across, high = places[1, 0] - places[0, 0], places[2, 1] - places[0, 1]
    assert across * player.window.aspect == pytest.approx(high, rel=0.02)
    # The ray of the cursor meets the point that is rendered at the cursor.
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


def test_an_idle_pool_sways_until_the_user_acts(player, show, monkeypatch):
    def level():
        return np.allclose(show.pose.tilt, np.eye(3), atol=1e-3)

    frames(player, 3)
    assert level() and player.idle.hint() == ""
    monkeypatch.setattr(idle, "IDLE_DELAY", 0.0)
    monkeypatch.setattr(idle, "RAMP_TIME", 1e-3)
    # The length of frames depends on the machine.
    for _ in range(300):
        frames(player)
        if not level():
            break
    assert not level() and player.idle.hint() == "drag: push the water"
    player.idle.tried.add("push")
    assert player.idle.hint() == "arrows: tilt"
    monkeypatch.setattr(idle, "IDLE_DELAY", 1e9)
    press(player, "l", number=2)
    assert level() and player.idle.hint() == ""


def test_the_idle_sway_waits_for_the_end_of_the_scenes_sway(show):
    sway = show.scene.sway.model_copy(update={"angle": 5.0, "seconds": 4.0})
    swaying = idle.Idle(show.scene.model_copy(update={"sway": sway}), depth=0.1)
    swaying.pass_time(2.0 * idle.IDLE_DELAY, busy=False)
    assert swaying.strength == 1.0
    assert swaying.roll(3.9, 0.1) == 0.0 and swaying.roll(4.1, 0.1) != 0.0
    swaying.pass_time(2.0 * idle.RAMP_TIME, busy=True)
    assert swaying.strength == 0.0


def test_a_saved_checkpoint_is_reopened(player, show, tmp_path):
    frames(player, 3)
    press(player, "o")
    assert "no checkpoint of pool" in player.layout.message
    np.savez(tmp_path / "pool_of_another_quality.npz", fluid=np.zeros(5))
    press(player, " ", "k")
    (tmp_path / "pool_of_another_quality.npz").touch()
    kept, moment = in_order(show.simulation.particles, "x"), show.simulation.time
    press(player, " ", number=4)
    press(player, " ", "o")
    assert np.array_equal(in_order(show.simulation.particles, "x"), kept)
    assert show.simulation.time == moment


def test_a_clip_has_the_displayed_images_and_the_simulation_goes_on(
    player, show, tmp_path, monkeypatch
):
    """Regression: images were rendered again, which stopped the simulation for 12 s."""
    monkeypatch.setattr(keepsakes, "FPS", 1000.0)
    frames(player, 4)
    show.display.views.name = "speed"
    frames(player, 4)
    monkeypatch.setattr(keepsakes, "FPS", 24.0)
    # Sets the times of the images as if they had been displayed over a third of a second.
    stored = [image for _, image in player.saver.clip.frames]
    assert len(stored) == 8
    player.saver.clip.frames.clear()
    player.saver.clip.frames.extend((k / 24.0, image) for k, image in enumerate(stored))
    before = show.simulation.time
    press(player, "c")
    assert show.simulation.time > before and "writing" in player.layout.message
    player.close()
    (path,) = tmp_path.glob("*.mp4")
    seen = [frame for frame in imageio.get_reader(path)]
    assert len(seen) == 7 and seen[0].shape == (HEIGHT, WIDTH, 3)
    assert np.abs(seen[0].astype(int) - seen[-1]).mean() > 1.0


def test_memory_of_the_clip_is_bounded(player, monkeypatch):
    monkeypatch.setattr(keepsakes, "FPS", 1e6)
    frames(player)
    (size,) = (len(image.result()) for _, image in player.saver.clip.frames)
    monkeypatch.setattr(keepsakes, "MOST_BYTES", 3.5 * size)
    for _ in range(8):
        frames(player)
        player.saver.clip.frames[-1][1].result()
    assert len(player.saver.clip.frames) <= 4
    # The last image is kept even if it exceeds the limit.
    monkeypatch.setattr(keepsakes, "MOST_BYTES", 0.5 * size)
    frames(player)
    assert len(player.saver.clip.frames) == 1


def test_write_errors_are_shown_as_messages(player, tmp_path):
    (tmp_path / "file").touch()
    player.saver.folder = tmp_path / "file"
    for key in ("p", "c", "k"):
        frames(player, 2)
        press(player, key)
        assert "file" in player.layout.message


def test_a_lost_session_is_offered_until_a_key_answers(player, cache):
    began = int(time.mktime((2026, 11, 29, 14, 32, 0, 0, 0, -1)) * 1e9)
    file = cache.with_name(f"session_gone_{began}.npz")
    file.parent.mkdir()
    file.touch()
    lost = player.lost = Choice("drop", "small", {"gravity": 3.0}, resume=file)
    frames(player)
    assert player.layout.message == "Enter continues drop of 14:32, any other key deletes it"
    # Mouse buttons do not answer the offer, which is shown again after another message.
    press(player, "LMB")
    player.layout.until = 0.0
    frames(player)
    assert player.lost and player.layout.message.startswith("Enter")
    press(player, "Return")
    assert player.next_choice == lost
    assert not player.wants_more(player.row) and file.exists()
    player.menu.next, player.lost = None, lost
    press(player, "v")
    assert player.lost is None and not file.exists() and player.wants_more(player.row)


def test_random_input_at_a_window_loses_no_water(player, show):
    dice = random.Random(1)
    mass = show.ledger.record(show.gravity()).mass
    names = [k for k in ACTIONS if ACTIONS[k] not in ("quit", "clip", "keep", "reopen", "picture")]
    window = player.window
    for _ in range(150):
        for _ in range(4):
            kind = dice.randrange(5)
            if kind == 0:
                window.pressed.append(dice.choice(names))
            elif kind == 1:
                window.held ^= {dice.choice(names)}
            elif kind == 2:
                window.at = np.array([dice.uniform(-0.3, 1.3), dice.uniform(-0.3, 1.3)])
            elif kind == 3:
                live = dice.choice(player.menu.live)
                value = dice.uniform(live.lo, live.hi)
                player.menu.set(live.key, value)
            else:
                window.held.clear()
        frames(player)
        player.menu.next, player.helping = None, False
    entry = show.ledger.record(show.gravity())
    assert entry.mass == pytest.approx(mass, rel=1e-6) and entry.outside == 0
    assert np.isfinite(show.simulation.particles.numpy("v")).all()


def test_the_scene_on_the_command_line_keeps_its_overrides():
    """Regression: under the name of that scene, the scene chosen last was played."""
    called = SceneArguments("pool", ("title=called",), ("'title=with spaces'",))
    titles = {label: scene.title for label, scene in called.scenes_of("pool").items()}
    assert titles == {"title=called": "called", "'title=with spaces'": "with spaces"}
    assert {s.title for s in called.scenes_of("drop").values()} == {load_scene("drop").title}
