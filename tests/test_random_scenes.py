"""Tests with random scenes and inputs (hypothesis): water conserves mass and momentum, and invalid
scenes, checkpoints, recordings and output names give one line within LIMIT. A scene that fails is
minimised and written to failing_scene.toml. `MSPH_EXAMPLES=10` draws ten times as many examples,
from a new seed."""

import json
import math
import signal
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, reject
from hypothesis import strategies as st

from msph.errors import BadInputError, MsphError
from msph.export.outputs import Outputs, check_outputs
from msph.fluid.boundary.rim import AllSpiltError
from msph.fluid.external_forces import ExternalForces, Hand
from msph.measure.ledger import Ledger
from msph.measure.past import time_of
from msph.own_files import claim, release
from msph.scene import SceneError, load_scene
from msph.scene.build import build_simulation
from msph.scene.load import to_toml
from msph.scene.meshes import MeshError, load_mesh
from msph.scene.parameters import parameters
from msph.scene.schema import Scene
from msph.stage.recorded_input import read as read_recording
from tests.scenes_kit import LAYERED, POOL, examples, load

FRAME, FRAMES = 1 / 60, 24
FAILING = Path("failing_scene.toml")
# Longest time of an attempt with invalid input [s], after which it counts as hanging.
LIMIT = 5.0


numbers = st.floats(allow_nan=True, allow_infinity=True)
texts = st.text(max_size=12)
# Numbers and expressions that have hung or crashed a part of the program.
hostile_numbers = st.sampled_from(
    [math.nan, math.inf, -math.inf, 1e300, 1e-300, 1e-320, 1e154, 1e30, 1e12, 1e6, -1.0, 0.0]
)
hostile = hostile_numbers | st.sampled_from(
    [2**62, 10**400, "9**4000000*0+t", "sqrt(0.1-t)", "1e9*t", "floor(1e300)**9**9", "1/t", "-t"]
)
anything = st.recursive(
    st.none() | st.booleans() | st.integers() | numbers | texts,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(texts, inner, max_size=3),
    max_leaves=6,
)


@st.composite
def scenes(draw):
    """Draws valid scenes: a box, one to three layers, water in the box, and in some a body."""
    size = [draw(st.floats(0.3, 0.8)) for _ in range(3)]
    depth = draw(st.floats(0.2, 0.9)) * size[1]
    spacing = draw(st.floats(0.05, 0.09))
    count = draw(st.integers(1, 3))
    layers = [{"mass": 1000.0 * spacing**3 * 2.0**k} for k in range(count)]
    adaptive = count > 1 and draw(st.booleans())
    data = {
        "title": "random",
        "box": {
            "size": size,
            "restitution": draw(st.sampled_from([0.0, 0.5])),
            "open": draw(st.booleans()),
        },
        "layers": layers,
        "water": [{"layer": count - 1, "lo": [0, 0, 0], "hi": [size[0], depth, size[2]]}],
        "adaptation": {"enabled": adaptive},
        "projection": {"viscosity": draw(st.sampled_from([0.0, 0.0, 10.0]))},
    }
    if draw(st.booleans()):
        radius = draw(st.floats(0.08, 0.14))
        centre = [draw(st.floats(0.3, 0.7)) * edge for edge in size]
        spin = draw(st.floats(-360.0, 360.0))
        data["bodies"] = [{"centre": centre, "radius": radius, "spin": spin}]
    return data


vectors = st.tuples(*[st.floats(-20.0, 20.0)] * 3)
hands = st.builds(
    Hand,
    st.tuples(*[st.floats(0.0, 0.5)] * 3),
    st.tuples(*[st.floats(-5.0, 5.0)] * 3),
    st.sampled_from([(0.15, 0.15, 0.15), (0.15, math.inf, 0.15)]),
    st.sampled_from([0.0, 20.0, 200.0]),
    st.tuples(*[st.sampled_from([0.0, 5.0])] * 3),
    st.sampled_from([0.0, 5.0, -5.0]),
)
inputs = st.lists(st.tuples(vectors, hands), min_size=1, max_size=4)


@examples(3)
@given(scenes(), inputs)
def test_water_stays_inside_and_conserves_mass_and_momentum(data, given_inputs):
    """The water is finite, and spilt water counts as inside."""
    try:
        scene = Scene.model_validate(data)
        simulation = build_simulation(scene)
    except SceneError:
        reject()
    try:
        check_promises(scene, simulation, given_inputs)
    except AllSpiltError:
        assert scene.box.open
    FAILING.unlink()


def check_promises(scene, simulation, given_inputs):
    """Runs a scene with the inputs in turn, then without input, and checks the ledger."""
    FAILING.write_text(to_toml(scene, f"gravity and hand by turns: {given_inputs}"))
    ledger = Ledger(simulation)
    mass = ledger.record(scene.gravity).mass
    for k in range(FRAMES):
        gravity, hand = given_inputs[k * len(given_inputs) // FRAMES]
        simulation.advance(FRAME, ExternalForces(gravity, hand))
        entry = ledger.record(gravity)
        assert entry.outside == 0
        assert entry.mass + entry.spilt == pytest.approx(mass, rel=1e-6)
    assert ledger.momentum_drift() < 1e-5
    # In 0.5 s without input, crowded particles move apart.
    for _ in range(30):
        simulation.advance(FRAME, ExternalForces(scene.gravity))
        entry = ledger.record(scene.gravity)
    assert entry.solver_residual_mean < 0.01


@examples(100)
@given(st.dictionaries(st.sampled_from([*Scene.model_fields, "variants", "boxes"]), anything))
def test_an_invalid_scene_gives_one_line(tmp_path_factory, data):
    path = tmp_path_factory.getbasetemp() / "random.toml"
    path.write_bytes(_toml(data))
    assert_one_line(lambda: load_scene(str(path)))


@examples(70)
@given(st.binary(max_size=200))
def test_random_bytes_as_scene_mesh_or_checkpoint_give_one_line(tmp_path_factory, content):
    folder = tmp_path_factory.getbasetemp()
    for name, read in (
        ("bytes.toml", lambda path: load_scene(str(path))),
        ("bytes.obj", lambda path: load_mesh.__wrapped__(str(path))),
        ("bytes.stl", lambda path: load_mesh.__wrapped__(str(path))),
        ("bytes.ply", lambda path: load_mesh.__wrapped__(str(path))),
        ("bytes.npz", time_of),
        ("bytes.jsonl", read_recording),
    ):
        path = folder / name
        path.write_bytes(content)
        assert_one_line(lambda path=path, read=read: read(path))


@pytest.fixture(scope="module")
def still(tmp_path_factory):
    """A small adaptive simulation with a floating body and a tap, and its state."""
    folder = tmp_path_factory.mktemp("still")
    simulation = build_simulation(load(folder, POOL + LAYERED + BODY))
    simulation.warm_up(1e-3)  # attempts are timed without compiling
    return simulation, simulation.state()


BODY = """
[[bodies]]
centre = [0.2, 0.25, 0.2]
radius = 0.08
density = 500
[[inflows]]
centre = [0.0, 0.1, 0.2]
radius = 0.05
speed = 0.1
[adaptation]
enabled = true
"""


@pytest.mark.parametrize("name", ["top_rate", "adaptation_steps", "adaptation_next_id"])
def test_impossible_numbers_of_the_solver_are_refused(still, name):
    """Regression: an infinite number gave a traceback, and a rate of 2^62 1/s hung."""
    simulation, state = still
    for number in (math.inf, math.nan, 2.0**62, -1.0):
        with pytest.raises(ValueError, match=f"solver.{name} is .*: must be"):
            simulation.restore({**state, f"solver.{name}": np.float64(number)})


@examples(60)
@given(st.data())
def test_a_changed_checkpoint_is_restored_or_gives_one_line(still, data):
    simulation, state = still
    name = data.draw(st.sampled_from(sorted(state)))
    change = data.draw(st.sampled_from(["fill", "scale", "kind", "shape", "missing", "one"]))
    found, number = state[name], data.draw(hostile_numbers)
    changed = {
        "fill": lambda: np.full(found.shape, number),
        "scale": lambda: (found * number).astype(found.dtype),
        "kind": lambda: found.astype(data.draw(st.sampled_from(["c16", "U4", "i1", "f2", "O"]))),
        "shape": lambda: np.asarray(found)[None],
        "missing": lambda: None,
        "one": lambda: np.where(np.arange(found.size).reshape(found.shape) == 0, number, found),
    }
    with np.errstate(all="ignore"):
        value = changed[change]()
    entries = {k: v for k, v in {**state, name: value}.items() if v is not None}

    def restore() -> None:
        simulation.restore(entries)
        simulation.advance(1e-3, ExternalForces(), budget=1.0)

    assert_one_line(restore, (ValueError, MsphError))


USE = {"tool": "push", "place": [0.2] * 3, "velocity": [0.0] * 3, "start": [0.2] * 3}
USE |= {"surface": [0.2] * 3, "direction": [0.0, -1.0, 0.0], "step": 0.01, "held": 0.01}
HEAD = '{"recording": 1, "msph": "0", "scene": "pool", "quality": "large"}'


@examples(60)
@given(
    st.dictionaries(
        st.sampled_from(sorted(USE)), hostile | st.lists(hostile, min_size=3), max_size=2
    ),
    st.dictionaries(
        st.sampled_from(["frame_time", "until", "tilt", "azimuth"]), hostile, max_size=2
    ),
)
def test_a_changed_recording_is_read_or_gives_one_line(tmp_path_factory, use, given_input):
    line = {"frame": 0, "time": 0.0, "input": {"frame_time": 0.01, "use": USE | use} | given_input}
    path = tmp_path_factory.getbasetemp() / "input.jsonl"
    path.write_text(f"{HEAD}\n{json.dumps(line)}")
    assert_one_line(lambda: read_recording(path))


KEYS = [p.key for p in parameters(Scene)]


@examples(100)
@given(
    st.lists(st.tuples(st.sampled_from(KEYS), anything | texts | hostile), min_size=1, max_size=3)
)
def test_any_override_is_accepted_or_gives_one_line(settings_given):
    overrides = tuple(f"{key}={value}" for key, value in settings_given)
    assert_one_line(lambda: load_scene("pool", overrides))


@examples(60)
@given(st.text(max_size=30))
def test_any_output_name_is_accepted_or_gives_one_line(tmp_path_factory, name):
    folder = tmp_path_factory.getbasetemp()
    path = folder / "in" / name.replace("/", "_")

    def use() -> None:
        check_outputs(Outputs([path]), 30.0)
        claim([path])

    assert_one_line(use)
    assert_one_line(lambda: claim([path], force=True))
    release()


def assert_one_line(act, errors=(BadInputError, MeshError)) -> None:
    """Asserts that an act ends within LIMIT, without an error or with one line."""

    def too_long(*_) -> None:
        raise TimeoutError(f"takes more than {LIMIT:g} s")

    before = signal.signal(signal.SIGALRM, too_long) if hasattr(signal, "SIGALRM") else None
    try:
        if before is not None:
            signal.setitimer(signal.ITIMER_REAL, LIMIT)
        act()
    except errors as error:
        assert "\n" not in str(error) and str(error)
    finally:
        if before is not None:
            signal.setitimer(signal.ITIMER_REAL, 0.0)
            signal.signal(signal.SIGALRM, before)


def _toml(data) -> bytes:
    """Returns the data as TOML, or as lines `key = repr(value)` if TOML cannot hold them."""
    import tomli_w

    try:
        return tomli_w.dumps(data).encode()
    except (TypeError, ValueError, UnicodeEncodeError, OverflowError):
        return b"\n".join(
            f"{key} = {value!r}".encode(errors="replace") for key, value in data.items()
        )
