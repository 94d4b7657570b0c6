"""Tests of the pacer of a window on modelled machines of known speed."""

import numpy as np
import pytest

from msph.stage.layout import pace
from msph.stage.pacer import LONGEST_FRAME, MAX_GROWTH, SCALES, Pacer

FPS = 60.0


def run(pacer, water, picture, rest=0.003, frames=600, noise=0.0):
    """Runs frames on a modelled machine with a display of 60 frames per second, on which the fluid
    runs while images are drawn; returns simulated and wall-clock time [s] of the second half.

    water [s]: wall-clock time per simulated second; picture [s]: time of an image of full scale;
    rest [s]: time of the rest of a frame; noise (-): relative variation of water and picture.
    """
    rng, halves = np.random.default_rng(0), [[0.0, 0.0], [0.0, 0.0]]
    for k in range(frames):
        slower = 1.0 + noise * rng.uniform(-1.0, 1.0)
        simulated = min(pacer.frame_time, pacer.budget / water)
        wet, drawn = slower * water * simulated, slower * picture * pacer.scale**2
        wall = max(wet, drawn + rest, 1.0 / FPS)
        pacer.record(wall, wet, drawn, rest, simulated)
        half = halves[2 * k // frames]
        half[0] += simulated
        half[1] += wall
    return halves[1]


@pytest.mark.parametrize("noise", [0.0, 0.3])
@pytest.mark.parametrize("speed", [1.0, 0.1])
@pytest.mark.parametrize(("water", "picture"), [(0.1, 0.004), (0.35, 0.012), (0.6, 0.025)])
def test_requested_speed_is_kept_if_the_fluid_alone_permits_it(water, picture, speed, noise):
    pacer = Pacer(FPS, speed)
    simulated, wall = run(pacer, water, picture, noise=noise)
    assert simulated / wall == pytest.approx(speed, rel=0.005)
    assert pacer.pace == pytest.approx(speed, rel=0.1)


def test_the_image_scale_falls_before_time_slows():
    quick, middling, slow = (Pacer(FPS) for _ in range(3))
    run(quick, 0.1, 0.006)
    run(middling, 0.35, 0.018)
    run(slow, 0.9, 0.030)
    assert quick.scale == SCALES[0]
    assert SCALES[-1] < middling.scale < SCALES[0]
    assert middling.wall == pytest.approx(1.0 / FPS, rel=0.05)
    assert slow.scale == SCALES[-1]


def test_time_slows_last_and_frames_are_limited_in_length():
    pacer = Pacer(FPS)
    simulated, wall = run(pacer, 3.0, 0.010)
    # An image at the smallest scale takes the rest of the time.
    assert simulated / wall == pytest.approx(1.0 / 3.0, rel=0.17)
    assert pacer.wall <= 1.02 * LONGEST_FRAME


def test_the_scale_changes_in_small_steps():
    """Regression: a jump to half the area was visible."""
    pacer, before = Pacer(FPS), SCALES[0]
    for _ in range(60):
        run(pacer, 0.9, 0.030, frames=1)
        assert abs(pacer.scale - before) < 0.11
        before = pacer.scale
    assert before == pytest.approx(SCALES[-1]) and SCALES[-1] >= 0.6


def test_the_image_scale_recovers_if_there_is_time():
    pacer = Pacer(FPS)
    run(pacer, 0.9, 0.030)
    assert pacer.scale == SCALES[-1]
    run(pacer, 0.1, 0.006)
    assert pacer.scale == SCALES[0]


def test_a_halt_is_not_caught_up():
    """After a halt of 1 s, such as the compilation of a kernel, the lag is not caught up."""
    pacer = Pacer(FPS)
    run(pacer, 0.1, 0.004)
    pacer.record(1.0, 0.002, 0.004, 0.003, 1.0 / FPS)
    assert pacer.frame_time <= LONGEST_FRAME
    simulated, wall = run(pacer, 0.1, 0.004, frames=60)
    assert simulated / wall < 1.05


def test_the_lag_of_a_splash_is_caught_up_gradually():
    """The water of half a second runs at 1.33 s per simulated second."""
    pacer, frames = Pacer(FPS), []
    run(pacer, 0.3, 0.004)
    for k in range(240):
        water = 1.33 if k < 15 else 0.3
        simulated = min(pacer.frame_time, pacer.budget / water)
        wall = max(water * simulated, 0.007, 1.0 / FPS)
        pacer.record(wall, water * simulated, 0.004, 0.003, simulated)
        frames.append((simulated, wall))
    assert np.divide(*np.sum(frames[:15], axis=0)) < 0.9
    assert np.divide(*np.sum(frames, axis=0)) == pytest.approx(1.0, abs=0.005)
    # The first frames after the splash are planned with its cost.
    assert max(np.divide(*frame) for frame in frames[17:]) < 1.01 * MAX_GROWTH


def test_another_speed_applies_at_once():
    pacer = Pacer(FPS)
    run(pacer, 0.1, 0.004)
    pacer.set_speed(0.1)
    assert pacer.frame_time == pytest.approx(0.1 / FPS, rel=0.1)
    assert pacer.pace == pytest.approx(0.1, rel=0.1)


def test_pace_shows_when_time_is_slow():
    pacer = Pacer(60.0)
    assert pace(pacer, paused=False) == "real time"
    assert pace(pacer, paused=True) == "paused"
    for _ in range(60):
        pacer.record(0.02, 0.01, 0.004, 0.003, 0.0084)
    assert pace(pacer, paused=False) == "0.42 times real time"
    pacer.set_speed(0.1)
    assert pace(pacer, paused=False) == "0.10 times real time"
