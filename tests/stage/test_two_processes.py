"""Tests of simulations in a process of their own: equal results, waits without a frozen window,
and the end of either process."""

import contextlib
import os
import pickle
import signal
import subprocess
import sys
import time
from pathlib import Path

import imageio.v2 as imageio
import numpy as np
import psutil
import pytest

from msph.fluid.boundary.rigid_bodies import Ball, centre
from msph.lesson.numbers import Numbers
from msph.measure.timings import Timings
from msph.options import CaptureOptions, RunOptions
from msph.own_files import release
from msph.scene import load_scene
from msph.scene.build import plan_of
from msph.stage.commands import capture
from msph.stage.controls import Controls, ToolUse
from msph.stage.layout import Layout
from msph.stage.link import Files, Order
from msph.stage.process import simulations, start_simulations
from msph.stage.recorded_input import Header, RecordedFrame, line_of, read
from msph.stage.remote import Remote, SimulationError
from msph.stage.row import speed_and_error
from msph.stage.show import INTERACTIVE, Show
from msph.state import Moment, Wanted
from msph.transfer import Packet, arrays_type, give_back, own_state, receive
from tests.command_kit import python, started
from tests.fluid.fluid_kit import in_order
from tests.scenes_kit import write
from tests.stage.player_kit import FRAME, SIZE, frames, played, press
from tests.tiers import slow_but

# Longest wait [s] for a process, also on a busy machine.
PATIENCE = 300.0
MEMORY = Path("/dev/shm")
on_linux = pytest.mark.skipif(sys.platform != "linux", reason="stops and kills processes")


def order_of(scene, files=None):
    return Order([load_scene(scene)], ["a"], files or Files(), numbers=Numbers)


@contextlib.contextmanager
def built(scene):
    """Yields a remote and the row of its simulation."""
    with Remote(*start_simulations("cpu", 1)) as remote:
        row = remote.row(order_of(scene), SIZE)
        yield remote, row
        row.close()


@pytest.fixture(scope="module")
def remote(tmp_path_factory):
    with built(write(tmp_path_factory.mktemp("scene"))) as (remote, row):
        yield remote, row


def shared():
    return set(MEMORY.glob("psm_*")) if MEMORY.is_dir() else set()


def check_no_new_names(before):
    """Checks that no name of shared memory stays but those `before`; names of other programs, such
    as tests that run at the same time, come and go."""
    left, deadline = shared() - before, time.monotonic() + 0.1 * PATIENCE
    while left and time.monotonic() < deadline:
        time.sleep(0.1)
        left &= shared()
    assert not left, "shared memory has a name that a crash leaves behind"


def answered(row):
    """Waits for the answer to the last input."""
    row.receive(PATIENCE)
    assert not row.busy


def inputs():
    """Returns the input of some frames: tilts, a tool, a change, a reset, a pause."""
    at, up = (0.2, 0.1, 0.2), (0.0, 0.0, 0.0)
    use = ToolUse("push", at, (1.0, 0.0, 0.0), at, at, (0.0, -1.0, 0.0), FRAME, FRAME)
    rain = ToolUse("rain", at, up, at, at, (0.0, -1.0, 0.0), FRAME, 6 * FRAME)
    given = [Controls(frame_time=FRAME, tilt=(0.01 * k, 0.0)) for k in range(6)]
    given += [Controls(frame_time=FRAME, use=u) for u in (use, rain, use)]
    given += [Controls(frame_time=FRAME, set={"gravity": 5.0}), Controls(still=True)]
    given += [Controls(frame_time=FRAME, reset=True), *[Controls(frame_time=FRAME)] * 5]
    return given


# Before `remote` is built, which then uses the same fields.
@pytest.mark.parametrize("replayed", slow_but([True], [False, True]))
def test_a_capture_in_two_processes_equals_one_in_a_single_process(replayed, tmp_path):
    """Images and recorded input are equal bit for bit on one thread, whitewater included."""
    scene, replay = write(tmp_path), None
    if replayed:
        replay, header = tmp_path / "input.jsonl", Header.of(scene, "large")
        given = enumerate(i.inputs() for i in inputs() if not i.still)
        lines = [header, *(RecordedFrame(k, 0.0, i) for k, i in given)]
        replay.write_text("".join(map(line_of, lines)))
    found = []
    for name, own in ("one", False), ("two", True):
        images, again = tmp_path / f"{name}_%02d.png", tmp_path / f"{name}.jsonl"
        options = CaptureOptions(50.0, SIZE, 0.19, (images,), record_input=again, replay=replay)
        run = RunOptions(() if replayed else ("picture.whitewater=true",), "cpu", 1)
        with simulations("cpu", 1, own) as process:
            capture(None if replayed else scene, options, run, process)
        release()
        found.append([path.read_bytes() for path in sorted(tmp_path.glob(f"{name}_*.png"))])
        found[-1].append(again.read_text().partition("\n")[2])
    assert len(found[0]) == 11 and len(set(found[0])) == 11
    assert found[0] == found[1]


def test_two_processes_compute_what_one_computes(remote):
    _, row = remote
    scene = row.lead.initial
    here = Show(scene, FRAME, SIZE, timings=Timings(keep=1), **INTERACTIVE)
    here.warm_up()
    for given in inputs():
        row.frame(given)
        answered(row)
        here.frame(given)
        assert row.lead.now.time == here.simulation.time
    names = "x", "v", "layer", "id"
    ours, theirs = (in_order(show.state.particles, *names) for show in (here, row.lead))
    assert all(map(np.array_equal, ours, theirs))
    assert row.lead.now.energy == here.now.energy
    assert row.lead.changes() == here.changes() == {"gravity": 5.0}
    ours, theirs = Numbers(here), Numbers(row.lead)
    names = "speed", "centre_y", "solver_residual", "volume_error"
    assert np.isnan(theirs.speed), "the simulation was not asked"
    for name in names:
        getattr(theirs, name)
    row.frame(Controls(still=True))
    answered(row)
    assert [getattr(theirs, n) for n in names] == pytest.approx([getattr(ours, n) for n in names])
    here.close()


def test_the_label_of_a_paused_simulation_has_no_time(remote):
    """Regression: the label said "0.0 ms"."""
    _, row = remote
    row.lead.timings.discard()
    row.frame(Controls(still=True))
    answered(row)
    row.lead.timings.close_frame()
    assert "ms" not in speed_and_error(row.lead)[0]


def test_a_body_that_is_added_has_no_mesh_sampled_again():
    """Regression: the bodies that the other process sent were other objects, so that the window
    waited for the samples of all meshes after each throw of a body."""
    body = "{mesh='torus.obj', scale=0.2, position=[0.3, 0.45, 0.3], density=300}"
    plan = plan_of(load_scene("still", (f"bodies=[{body}]",)))
    state = own_state(plan)
    mesh, added = state.boundary.bodies[0], Ball(np.array([0.1, 0.5, 0.1]), 0.05, mass=0.1)
    bodies = pickle.loads(pickle.dumps([*plan.bodies, added]))
    centres, turns = np.array([centre(b) for b in bodies]), np.array([np.eye(3)] * 2)
    packet = Packet(Moment(), Wanted(), 1, False, centres, turns, bodies, None)
    receive(state, packet, np.zeros(1, arrays_type(1))[0])
    assert state.boundary.bodies[0] is mesh and state.boundary.count == 2
    give_back(state)


@on_linux
def test_numbers_from_before_a_reset_are_unknown_after_it(remote):
    """Otherwise a task of a lesson that was restarted would be complete at once."""
    remote, row = remote
    numbers = Numbers(row.lead)
    for _ in range(2):
        assert numbers.time != 0.0
        row.frame(Controls())
        answered(row)
    assert numbers.time > 0.0
    process = psutil.Process(remote.process.pid)
    process.suspend()
    row.frame(Controls())
    row.reset()
    process.resume()
    answered(row)
    assert np.isnan(numbers.time), "this is the answer to the input before the reset"
    row.frame(Controls(still=True))
    answered(row)
    assert numbers.time == 0.0


@pytest.mark.slow
@on_linux
def test_a_capture_whose_simulation_is_killed_keeps_its_frames(tmp_path):
    scene = write(tmp_path)
    command = ["capture", scene, "--seconds", "1000", "--arch", "cpu", "--size", "64x36"]
    process = started(*command, "-o", tmp_path / "a.mp4", "-o", tmp_path / "a_%04d.png")
    deadline = time.monotonic() + PATIENCE
    while not list(tmp_path.glob("a_0003.png")):
        assert process.poll() is None and time.monotonic() < deadline
        time.sleep(0.1)
    (simulation,) = (
        child
        for child in psutil.Process(process.pid).children()
        if "spawn_main" in " ".join(child.cmdline())
    )
    simulation.kill()
    said = process.communicate(timeout=PATIENCE)[1].splitlines()
    assert process.returncode == 1 and "has ended (signal 9)" in said[-1], said
    assert imageio.get_reader(tmp_path / "a.mp4").count_frames() >= 3


@on_linux
def test_the_window_answers_while_the_simulation_does_not(remote):
    """Keys, views, sliders and camera act at once; input for the simulation is kept and applied."""
    remote, row = remote
    player = played(row, Layout(SIZE))
    frames(player, number=2)
    answered(row)
    before, process = row.lead.now.time, psutil.Process(remote.process.pid)
    process.suspend()
    try:
        frames(player)
        assert row.busy
        azimuth = row.lead.display.camera.azimuth
        player.window.held = {"d"}
        press(player, "h", "v", "n", "r")
        player.window.held = set()
        assert player.helping and row.lead.display.views.name != "water"
        assert row.lead.display.camera.azimuth != azimuth
        player.menu.set("gravity", 3.0)
        assert row.lead.scene.gravity[1] == -3.0
        for _ in range(2):
            player.window.pressed = ["LMB"]
            frames(player)
        assert len(player.steering.clicks) == 2 and row.lead.now.time == before
        while not row.waiting:
            frames(player)
        assert row.waiting.startswith("waiting for the simulation")
    finally:
        process.resume()
    answered(row)
    resets = row.lead.now.resets
    for _ in range(4):
        frames(player)
        answered(row)
    assert row.lead.now.resets == resets + 1 and not player.steering.clicks
    assert not row.waiting and row.lead.changes()["gravity"] == 3.0
    player.close()


@on_linux
def test_signals_of_a_terminal_are_left_to_the_window(remote):
    """Regression: a process that was interrupted while Python started printed a traceback."""
    remote, row = remote
    status = Path(f"/proc/{remote.process.pid}/status").read_text()
    (blocked,) = (line.split()[1] for line in status.splitlines() if line.startswith("SigBlk"))
    assert int(blocked, 16) & 1 << (signal.SIGINT - 1)
    answered(row)
    os.kill(remote.process.pid, signal.SIGINT)
    row.frame(Controls())
    answered(row)


@pytest.mark.slow
def test_errors_of_a_scene_are_told_and_the_process_lives_on(tmp_path):
    good, bad = tmp_path / "good", tmp_path / "bad"
    good.mkdir(), bad.mkdir()
    scene = write(good)
    with built(scene) as (remote, row):
        row.close()
        recording = Header.of(str(scene), "large")
        files = Files(record=bad / "missing" / "file", header=recording, autosave=bad / "a.npz")
        (bad / "missing").write_text("")
        with pytest.raises(SimulationError, match="not a folder"):
            remote.row(order_of(scene, files), SIZE)
        row = remote.row(order_of(scene), SIZE)
        row.frame(Controls())
        answered(row)
        row.close()


@on_linux
def test_a_killed_simulation_ends_the_session_and_keeps_its_recording(remote, tmp_path):
    """The last test of the shared process."""
    (remote, row), scene, path = remote, write(tmp_path), tmp_path / "input.jsonl"
    row.close()
    files = Files(record=path, header=Header.of(str(scene), "large"))
    told, before = "the process of the simulation has ended .signal 9", shared()
    with pytest.raises(SimulationError, match=told):
        row = remote.row(order_of(scene, files), SIZE)
        check_no_new_names(before)
        for _ in range(5):
            row.frame(Controls())
            answered(row)
        os.kill(remote.process.pid, signal.SIGKILL)
        for _ in range(2):
            row.frame(Controls())
            row.receive(PATIENCE)
    assert read(path).moving >= 5
    check_no_new_names(before)


ENDED = """
import os, signal
from multiprocessing.shared_memory import SharedMemory
from msph.stage.process import simulations
with simulations("cpu", 1):
    print(SharedMemory(create=True, size=16).name, flush=True)
    os.kill(os.getpid(), signal.SIGKILL)
"""


@on_linux
def test_shared_memory_of_ended_processes_is_removed_without_a_word():
    """Regression: `timeout` during a start left a warning of Python's resource tracker."""
    run = python("-c", ENDED, may_fail=True)
    assert not (MEMORY / run.stdout.strip()).exists()
    assert run.stderr in ("", "msph: the main process has ended\n")


WINDOW = """
import sys
from tests.stage.test_two_processes import built, Controls, answered
from msph.device import start
start("cpu", 1)
with built(sys.argv[1]) as (remote, row):
    print(remote.process.pid, flush=True)
    while True:
        row.frame(Controls())
        answered(row)
"""


@pytest.mark.slow
@on_linux
def test_a_killed_window_ends_its_simulation(tmp_path):
    scene, before = write(tmp_path), shared()
    command = [sys.executable, "-c", WINDOW, str(scene)]
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=Path.cwd()
    )
    other = psutil.Process(int(process.stdout.readline()))
    process.kill()
    deadline = time.monotonic() + PATIENCE
    while psutil.pid_exists(other.pid) and other.status() != psutil.STATUS_ZOMBIE:
        assert time.monotonic() < deadline, "the simulation runs on"
        time.sleep(0.1)
    said = process.stderr.read()
    assert said.splitlines()[-1] == "msph: the main process has ended", said
    check_no_new_names(before)
