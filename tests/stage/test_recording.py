"""Tests of recorded input: replays give the same particles, bit for bit, in every command."""

import itertools
import json
import math
import time

import numpy as np
import pytest

from msph.scene import load_scene
from msph.stage import commands
from msph.stage.choice import Choice, SceneArguments
from msph.stage.controls import Controls
from msph.stage.input_relays import InputRecorder, Replayer
from msph.stage.layout import Layout
from msph.stage.loop import Audience, run
from msph.stage.recorded_input import Header, Recording, RecordingError, read
from msph.stage.row import Row
from msph.stage.show import INTERACTIVE, SIMULATED, Show
from msph.stage.tools import TOOLS
from tests.command_kit import done, here
from tests.scenes_kit import POOL, WATER, write
from tests.stage.player_kit import FRAME, SIZE, Asked, Screen, Sender

SCENE = POOL + WATER
OVERRIDES = ("method=projection", "adaptation.enabled=true")
FRAMES = 130
TICK = 0.01  # [s]


class Script(Screen):
    """Window double with scripted input by frame number: all tools, tilt, jolt, sliders, a pause in
    which the pool is tilted, a single step, slow motion, a view, an orbit and a reset."""

    def __init__(self):
        super().__init__()
        self.frame, self.player = -1, None
        keys = {2: "j", 74: " ", 78: "n", 82: " ", 84: "m", 88: "m", 92: "r", 94: "v", 98: "v"}
        self.keys = {k: [key] for k, key in keys.items()}
        self.keys |= {8 + 7 * k: [tool.key] for k, tool in enumerate(TOOLS)}

    def presses(self):
        k = self.player.row.lead.frames
        if k == self.frame:
            return []
        self.frame = k
        self.at = np.array([0.4 + 0.2 * (k % 7) / 7, 0.35 + 0.1 * (k % 5) / 5])
        self.held = {"LMB"} if 8 < k < 72 and k % 7 != 1 else set()
        self.held |= {"Left"} if 70 < k < 80 or 110 < k < 120 else set()
        self.held |= {"d"} if 100 < k < 105 else set()
        if k == 20:
            self.player.menu.set("gravity", 5.0)
        if k == 30:
            self.player.menu.set("gravity", None)
        return [*self.keys.get(k, []), *(["LMB"] if "LMB" in self.held and k % 7 == 2 else [])]


@pytest.fixture(scope="module")
def played(tmp_path_factory):
    """Returns the input file of a session and the state at its end. The clock advances by TICK at
    each reading, so that some frames end early, the same ones on every machine."""
    folder = tmp_path_factory.mktemp("session")
    scene, ticks = write(folder, SCENE), itertools.count()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(time, "perf_counter", lambda: TICK * next(ticks))
        return session(folder, scene)


def session(folder, scene):
    show = Show(load_scene(scene, OVERRIDES), FRAME, SIZE, **INTERACTIVE)
    show.warm_up()
    window, path = Script(), folder / "session.jsonl"
    row, arguments = Asked([show]), SceneArguments(scene, OVERRIDES)
    window.player = Sender(window, row, Choice(scene, "large"), Layout(SIZE), arguments)
    header = Header.of(scene, "large", OVERRIDES)
    run(row, window.player, FRAMES, [InputRecorder(path, header)])
    state = show.simulation.state()
    row.close()
    return path, state


def same(state, other):
    """Checks that two states are equal, except for the densities, measured at different times."""
    assert set(state) == set(other) and state["time"] > 0.0
    for name, values in state.items():
        if name == "density":
            continue
        assert np.array_equal(values, other[name]), name


class Count(Audience):
    """Audience without input that counts its frames."""

    def __init__(self):
        self.frames = 0

    def wants_more(self, row):
        return True

    def observe(self, row):
        self.frames += 1


def test_a_recording_contains_all_input_that_acts_on_the_water(played):
    recording = read(played[0])
    inputs = [frame.input for frame in recording.frames]
    used = {given.use.tool for given in inputs if given.use}
    assert used == {"hover", *(tool.name for tool in TOOLS)}
    assert [given.set for given in inputs if given.set] == [{"gravity": 5.0}, {"gravity": None}]
    assert sum(given.reset for given in inputs) == 1
    assert any(given.still and given.tilt != (0.0, 0.0) for given in inputs)
    times = [frame.time for frame in recording.frames if not frame.input.still]
    starts = np.cumsum([0.0, *(f.duration for f in recording.frames if not f.input.still)])
    reset = next(k for k, given in enumerate(inputs) if given.reset)
    moving = sum(not given.still for given in inputs[: reset + 1])
    assert times[:moving] == pytest.approx(starts[:moving])
    assert any(given.until for given in inputs)
    assert len(recording.frames) < FRAMES, "frames of the pause are written once"


def test_a_headless_replay_equals_the_session_bit_for_bit(played, tmp_path):
    path, state = played
    recording, count = read(path), Count()
    row = Row([Show(load_scene(recording.header.scene, OVERRIDES), FRAME, **SIMULATED)])
    again = tmp_path / "again.jsonl"
    recorder = InputRecorder(again, recording.header)
    run(row, Replayer(count, recording), witnesses=[recorder])
    same(row.lead.simulation.state(), state)
    assert count.frames == recording.moving
    row.close()
    # The input recorded from the replay differs only in the frame numbers.
    assert [f.input for f in read(again).frames] == [f.input for f in recording.frames]


def test_a_replay_in_a_window_ignores_user_input_until_its_end(played):
    path, state = played
    recording = read(path)
    show = Show(load_scene(recording.header.scene, OVERRIDES), FRAME, SIZE, **INTERACTIVE)
    row, window = Asked([show]), Screen()
    choice, arguments = Choice("pool", "large"), SceneArguments("pool")
    player = Sender(window, row, choice, Layout(SIZE), arguments)
    replayer = Replayer(player, recording, in_window=True)
    for k in range(len(recording.frames)):
        window.pressed = [" "] if k in (40, 41) else ["e"]
        window.held = {"LMB", "Left"}
        row.frame(replayer.controls(row))
        replayer.observe(row)
    # For one frame the user had paused the replay.
    row.frame(replayer.controls(row))
    same(show.simulation.state(), state)
    replayer.observe(row)
    assert player.layout.message == "the recorded input ends here"
    time = show.simulation.time
    row.frame(replayer.controls(row))
    assert show.simulation.time > time and show.pose.tilt[0, 1] != 0.0
    row.close()


def test_capture_and_measure_end_in_the_state_of_the_session(played, tmp_path):
    path, state = played
    duration = read(path).duration
    number = math.ceil(duration)
    done(
        *("capture", "--replay", path, "--fps", number / duration, "--size", "64x36"),
        *("-o", tmp_path / "a.png", "--particles", tmp_path / "p_%02d.npz"),
    )
    done("measure", "--replay", path, "-o", tmp_path / "measured")
    for file in (f"p_{number - 1:02d}.npz", "measured/checkpoint.npz"):
        with np.load(tmp_path / file) as found:
            same(state, dict(found))
    summary = json.loads((tmp_path / "measured/summary.json").read_text())
    assert summary["complete"] and abs(summary["errors"]["mass_change"]) < 1e-6


def test_a_capture_records_the_frames_that_are_due(played, tmp_path):
    path, _ = played
    end = read(path).duration
    names = tmp_path / "p_%03d.npz"
    done("capture", "--replay", path, "--fps", "20", "--seconds", "0.5", "--particles", names)
    files = sorted(tmp_path.glob("p_*.npz"))
    assert len(files) == 10 < 20 * end
    times = [float(np.load(file)["time"]) for file in files]
    late = np.array(times) - np.arange(1, 11) / 20
    assert (late > -1e-6).all() and (late < 1 / 20).all()


def test_bench_runs_the_recorded_frames(played, tmp_path):
    rows = tmp_path / "rows.json"
    done("bench", "--replay", played[0], "--no-render", "--json", rows)
    assert json.loads(rows.read_text())[0]["frames"] == read(played[0]).moving


def test_play_without_a_display_records_and_replays(played, tmp_path, monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.setattr(commands, "FALLBACK_SIZE", (64, 36))
    monkeypatch.chdir(tmp_path)
    done("play", "--replay", played[0], "--record-input", "again.jsonl")
    again = read(tmp_path / "again.jsonl")
    assert [f.input for f in again.frames] == [f.input for f in read(played[0]).frames]
    assert here("play", "--record-input", "again.jsonl").returncode == 2
    assert list(tmp_path.glob("out/*.mp4"))


HEAD = {"recording": 1, "msph": "0", "scene": "pool", "quality": "large"}
STEP = {"frame": 0, "time": 0.0, "input": {"frame_time": 0.01}}
USE = {**dict.fromkeys(("place", "velocity", "start", "surface", "direction"), (0, 0, 0))}
USE |= {"tool": "push", "step": 0.01, "held": 0.01}


def with_input(**changes):
    return {**STEP, "input": {**STEP["input"], **changes}}


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        ([], "is empty"),
        (["{"], "line 1: is not JSON"),
        ([{**HEAD, "recording": 2}], "line 1: recording: input should be 1"),
        ([HEAD], "has no frames in which time passes"),
        ([HEAD, STEP, STEP], "line 3: frame 0 follows frame 0"),
        ([HEAD, {**STEP, "input": {}}], "line 2: input.frame_time: is missing"),
        ([HEAD, with_input(frame_time=float("inf"))], "line 2: input.frame_time: input should be"),
        ([HEAD, with_input(wind=1.0)], "line 2: input.wind: unexpected keyword"),
        ([HEAD, with_input(tilt=[1.0])], "line 2: input.tilt.1: field required"),
        ([HEAD, with_input(use={**USE, "tool": "pusch"})], "tool: 'pusch'; did you mean 'push'"),
        ([HEAD, with_input(use={**USE, "place": [1e9, 0, 0]})], "line 2: input.use.place.0: "),
        ([HEAD, with_input(use={**USE, "step": -1.0})], "line 2: input.use.step: "),
        ([HEAD, with_input(use={**USE, "step": 1e6})], "line 2: input.use.step: "),
        ([HEAD, with_input(set={"gravity": float("nan")})], "line 2: input.set.gravity: "),
    ],
)
def test_invalid_recordings_are_refused_in_one_line(lines, message, tmp_path):
    path = tmp_path / "input.jsonl"
    path.write_text("\n".join(x if isinstance(x, str) else json.dumps(x) for x in lines))
    with pytest.raises(RecordingError) as error:
        read(path)
    assert message in str(error.value) and "\n" not in str(error.value)


def test_unknown_and_excessive_parameters_are_refused(played):
    header, scene = read(played[0]).header, load_scene("pool")
    for changes, message in (
        ({"gravty": 1.0}, "gravty: did you mean 'gravity'"),
        ({"gravity": 1e3}, "gravity: is 1000, must be"),
    ):
        frames = read(played[0]).frames[:1]
        frames[0].input.set.update(changes)
        with pytest.raises(RecordingError, match=message):
            Recording(header, frames).check(scene)


def test_a_replay_with_another_scene_name_is_refused(played):
    assert "names its scene" in here("capture", "drop", "--replay", played[0]).stderr


def test_continuing_from_a_checkpoint_ends_a_recording(tmp_path):
    show = Show(load_scene(write(tmp_path, SCENE), OVERRIDES), FRAME, **SIMULATED)
    row, path = Row([show]), tmp_path / "input.jsonl"
    recorder, controls = InputRecorder(path, Header.of("pool", "large")), Controls()
    for k in range(4):
        recorder.given(row, controls)
        row.frame(controls)
        recorder.observe(row)
        if k == 1:
            show.simulation.time += 1.0
    assert [frame.frame for frame in read(path).frames] == [0, 1]
    row.close()
