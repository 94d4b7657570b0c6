"""Tests of the progress: lines in a log, slow frames, and runs that take more than a day."""

import pytest

from msph.launches import compile_time
from msph.scene import load_scene
from msph.stage.progress import Progress, TooLongError, running_time
from msph.stage.show import Show
from tests.stage.player_kit import Stopwatch


@pytest.fixture
def clock():
    return Stopwatch()


def pace():
    return "steps of 1e-9 s"


def test_a_slow_frame_is_explained_once(clock, capsys):
    progress = Progress(10, shown=True, clock=clock)
    progress.within(0.1, pace)
    assert capsys.readouterr().err == ""
    clock.sleep(4.0)
    progress.within(0.5, pace)
    line = "frame 1 of 10 takes long: steps of 1e-9 s; the run takes about 1.3 minutes\n"
    assert capsys.readouterr().err == line
    clock.sleep(4.0)
    progress.within(1.0, pace)
    assert capsys.readouterr().err == ""


def test_a_run_of_days_is_refused_with_its_estimate(clock):
    """Regression: with cfl = 1e-9, a run that needed years gave no message."""
    progress = Progress(100, shown=True, clock=clock)
    for share in (0.001, 0.002):
        clock.sleep(4.0)
        if share == 0.001:
            progress.within(share, pace)
    with pytest.raises(TooLongError, match=r"frame 1 of 100 .*the run would take 4.6 days"):
        progress.within(share, pace)


def test_a_single_halt_of_the_machine_does_not_end_the_run(clock):
    progress = Progress(100, shown=False, clock=clock)
    clock.sleep(3600.0)
    progress.within(0.1, pace)
    for _ in range(5):
        clock.sleep(4.0)
        progress.update()
        progress.within(0.1, pace)
    assert progress.done == 5


def test_a_log_gets_a_line_per_tenth(clock, capsys):
    """Regression: a log got a line per frame, 50 kB for two seconds."""
    progress = Progress(300, shown=True, clock=clock)
    for _ in range(300):
        clock.sleep(0.1)
        progress.update()
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 10
    assert lines[0] == "10 %: frame 30 of 300, 3 seconds, 27 seconds left"
    assert lines[-1] == "100 %: frame 300 of 300, 30 seconds"


def test_the_time_left_does_not_count_the_first_frame(clock, capsys):
    """The first frame waits for kernels, which may compile in another process; regression."""
    progress = Progress(10, shown=True, clock=clock)
    for seconds in (60.0, 1.0, 1.0):
        clock.sleep(seconds)
        progress.update()
    lines = capsys.readouterr().err.splitlines()
    assert lines[0] == "10 %: frame 1 of 10, 1 minute"
    assert lines[-1] == "30 %: frame 3 of 10, 1 minute, 7 seconds left"


def test_a_short_run_gets_at_most_a_line_per_frame(clock, capsys):
    progress = Progress(3, shown=True, clock=clock)
    for _ in range(3):
        progress.update()
    assert len(capsys.readouterr().err.splitlines()) == 3


def test_preparation_takes_two_steps_however_short_they_are():
    """Regression: a whole frame was simulated, which never ended with cfl = 1e-9."""
    show = Show(load_scene("still", ("projection.cfl=1e-9", "layers.0.spacing=0.1")), 1 / 60)
    steps = []
    step = show.simulation.solver.step
    show.simulation.solver.step = lambda *given: (steps.append(given[0]), step(*given))
    show.warm_up()
    assert len(steps) == 2
    assert "limited by projection." in show.pace()
    show.close()


def test_compiling_does_not_lengthen_the_expected_time(monkeypatch):
    """Regression: a run of 1.5 minutes was announced as 11 hours: its first frame compiled."""
    before = running_time()
    monkeypatch.setattr("msph.stage.progress.compile_time", lambda: compile_time() + 3600.0)
    assert running_time() < before - 3500.0
