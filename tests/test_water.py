"""Tests of `import msph`: simulations in scripts."""

import gc
import math

import numpy as np
import pytest

import msph
from msph.launches import watch_compiling
from tests.command_kit import here

POOL = {
    "box": {"size": (0.4, 0.4, 0.4)},
    "layers": [{"spacing": 0.04}],
    "water": [{"lo": [0, 0, 0], "hi": np.array([0.4, 0.2, 0.4])}],
    "probes": [{"name": "gauge", "kind": "height", "at": [0.04, 0.04]}],
}
BALL = {"name": "ball", "centre": (0.2, 0.22, 0.2), "radius": 0.08, "density": 500}


@pytest.fixture
def water():
    with msph.open(POOL, set={"bodies": [BALL]}) as found:
        yield found


def test_a_frame_holds_particles_bodies_probes_and_ledger(water):
    assert water.frame.time == 0.0 and math.isnan(water.frame.bodies["ball"].force[1])
    water.probe("pressure", name="floor", point=(0.05, 0.0, 0.05))
    *_, frame = water.frames(seconds=0.1)
    n = len(frame.particles.x)
    assert frame.time == pytest.approx(0.1) and water.time == frame.time
    assert frame.particles.v.shape == (n, 3) and frame.particles.pressure.shape == (n,)
    assert (frame.particles.spacing**3).sum() * 1000 == pytest.approx(frame.ledger.mass, rel=1e-5)
    assert frame.gauge == frame.probes["gauge"] and 0.15 < frame.gauge < 0.25
    assert frame.floor == pytest.approx(1000 * 9.81 * 0.2, rel=0.2)
    ball = frame.bodies["ball"]
    assert np.array_equal(water.bodies["ball"].position, ball.position)
    assert water.bodies["bodies.0"].mass == pytest.approx(500 * 4 / 3 * np.pi * 0.08**3)
    assert ball.force[1] > 0.0
    with pytest.raises(AttributeError, match="no attribute or probe 'depth'; probes: gauge, floor"):
        _ = frame.depth


def test_a_force_moves_a_body_for_one_frame_and_its_work_is_recorded():
    """A ball in weightless air: F t = m v, and the work of the user is the kinetic energy."""
    alone = {**BALL, "centre": (0.2, 0.3, 0.2)}
    nothing = {"gravity": (0, 0, 0), "bodies": [alone], "water.0.hi": (0.4, 0.08, 0.4)}
    with msph.open(POOL, set=nothing) as water:
        ball = water.bodies["ball"]
        ball.push((0.5, 0, 0))
        ball.push((0.5, 0, 0), at=np.add(ball.position, (0, 0.05, 0)))
        first, second = water.frames(seconds=2 / 60)
    speed = 1.0 / 60.0 / (500 * 4 / 3 * np.pi * 0.08**3)
    assert first.bodies["ball"].velocity == pytest.approx([speed, 0, 0], rel=1e-6)
    assert second.bodies["ball"].velocity == pytest.approx([speed, 0, 0], rel=1e-6)
    assert first.bodies["ball"].spin[2] < 0.0
    assert second.ledger.user_impulse == pytest.approx([1.0 / 60.0, 0, 0], rel=1e-6)
    assert second.ledger.user_work == pytest.approx(second.ledger.floating_kinetic, rel=1e-4)


def test_simulations_in_turn_share_kernels_and_keep_their_results(tmp_path):
    """Each gives what it gives alone, bit for bit, without further compiling."""
    heavy = {"bodies": [{**BALL, "density": 800}]}
    alone = []
    for changes in ({"bodies": [BALL]}, heavy):
        with msph.open(POOL, set=changes) as water:
            alone.append(list(water.frames(seconds=0.1)))
            water.image(64, 36)
    with msph.open(POOL, set={"bodies": [BALL]}) as one, msph.open(POOL, set=heavy) as other:
        for _ in zip(one.frames(0.02), other.frames(0.02), strict=True):
            one.image(64, 36)
        one.reset()
        other.reset()
        kernels = []
        with watch_compiling(kernels.append):
            pairs = list(zip(one.frames(0.1), other.frames(0.1), strict=True))
            images = [water.image(64, 36) for water in (one, other, one)]
        one.save(tmp_path / "one.npz")
    assert kernels == []
    assert np.array_equal(images[0], images[2]) and not np.array_equal(images[0], images[1])
    for frames, found in zip(alone, zip(*pairs, strict=True), strict=True):
        assert np.array_equal(frames[-1].particles.x, found[-1].particles.x)
        assert frames[-1].ledger.mechanical == found[-1].ledger.mechanical
        assert np.array_equal(frames[-1].bodies["ball"].force, found[-1].bodies["ball"].force)
        assert frames[-1].gauge == found[-1].gauge
    with np.load(tmp_path / "one.npz") as state:
        assert np.array_equal(state["x"], pairs[-1][0].particles.x)


def test_an_image_does_not_show_the_spray_of_other_water():
    """A film is drawn whole, also if its numbers were those of lone particles in the last image."""
    film = {"water": [{"lo": (0, 0, 0), "hi": (0.4, 0.04, 0.4)}]}
    lone = {"water": [{"lo": (0.2, 0.2, 0.2), "hi": (0.24, 0.24, 0.24)}, *film["water"]]}
    with msph.open(POOL, set=lone) as water:
        water.image(64, 36)
    with msph.open(POOL, set=film) as water:
        first = water.image(64, 36)
        water.reset()
        assert np.array_equal(first, water.image(64, 36))


def test_water_in_the_air_has_relief_and_calm_water_has_none():
    """Ripples on or off, images of calm water are equal, and of a lump that flies above it not."""
    lump = {"lo": (0.08, 0.2, 0.16), "hi": (0.32, 0.36, 0.24)}
    calm = {"lo": (0, 0, 0), "hi": (0.4, 0.12, 0.4)}
    changed = []
    for water in ([calm], [calm, lump]):
        images = []
        for ripples in (True, False):
            with msph.open(POOL, set={"water": water, "picture.ripples": ripples}) as opened:
                images.append(opened.image(160, 90).astype(int))
        changed.append((abs(images[0] - images[1]).max(axis=2) > 8).mean())
    assert changed[0] == 0.0 and changed[1] > 0.003, changed


def test_dropped_simulations_return_their_fields():
    from msph.fluid import world

    with msph.open(POOL):
        pass
    before = len(world._stock)
    msph.open(POOL)
    gc.collect()
    assert len(world._stock) == before


def test_a_checkpoint_continues_the_run(water, tmp_path):
    *_, _ = water.frames(seconds=0.05)
    water.save(tmp_path / "state.npz")
    *_, through = water.frames(seconds=0.05)
    water.load(tmp_path / "state.npz")
    assert water.time == pytest.approx(0.05)
    *_, again = water.frames(seconds=0.05)
    assert np.array_equal(through.particles.x, again.particles.x)


def test_tilt_moves_the_water(water):
    water.tilt = (0.2, 0.0)
    *_, frame = water.frames(seconds=0.2)
    assert frame.ledger.gravity[0] != 0.0 and abs(frame.ledger.momentum[0]) > 0.01


def test_images_meshes_and_recordings(water, tmp_path):
    assert water.image(64, 36).shape == (36, 64, 3) and water.show(64, 36).size == (64, 36)
    mesh = water.mesh(layer=True)
    assert mesh.is_watertight and mesh.volume == pytest.approx(0.4 * 0.4 * 0.2, rel=0.1)
    assert mesh.vertex_attributes["velocity"].shape == mesh.vertices.shape
    assert set(mesh.vertex_attributes) == {"velocity", "foam", "layer"}
    ball = water.bodies["ball"].mesh()
    assert ball.center_mass == pytest.approx(BALL["centre"], abs=1e-3)
    files = {"meshes": tmp_path / "s_%02d.ply", "particles": tmp_path / "p_%02d.csv"}
    for _ in range(2):  # the second time over the files of the first
        written = water.record(tmp_path / "a.webp", seconds=0.1, size=(64, 36), **files)
    assert {p.name for p in written} == {"a.webp", "s_%02d.ply", "p_%02d.csv"}
    assert len(list(tmp_path.iterdir())) == 1 + 3 + 3
    assert water.time == pytest.approx(0.2)


@pytest.mark.parametrize(
    ("command", "given"),
    [
        (["no_such_scene"], {"scene": "no_such_scene"}),
        (["pool", "--set", "box.sise=3"], {"set": {"box.sise": 3}}),
        (["pool", "--set", "variant=none"], {"set": {"variant": "none"}}),
        (["pool", "--quality", "best"], {"quality": "best"}),
        (["pool", "--arch", "abacus"], {"arch": "abacus"}),
        (["pool", "--threads", "0"], {"threads": 0}),
    ],
)
def test_errors_have_the_text_of_the_command(command, given):
    with pytest.raises(msph.MsphError) as error:
        msph.open(**{"scene": "pool", **given})
    assert here("capture", *command).stderr == f"msph: {error.value}\n"


def test_other_errors_are_one_line(water, tmp_path):
    calls = {
        "scene: probes.1: a height probe needs at": lambda: water.probe("height"),
        "scene: probes.1.kind: input should be 'pressure'": lambda: water.probe("depth"),
        "there are two probes named 'gauge'": lambda: water.probe("height", "gauge", at=(0, 0)),
        "the scene has no body duck; known: ball": lambda: water.bodies["duck"],
        "force and point are three": lambda: water.bodies["ball"].push((math.nan, 0, 0)),
        "ball: force and point": lambda: water.bodies["ball"].push((1.0, 0.0)),
        "tilt: is two finite numbers": lambda: tilted(water, (math.nan, 0.0)),
        "'--size': '0x9': expected WIDTHxHEIGHT": lambda: water.image(0, 9),
        "a.xyz: unknown kind of file": lambda: water.record(tmp_path / "a.xyz", 0.1),
        "is not in the range 0<x": lambda: next(water.frames(-1.0)),
        "'--resume': File": lambda: water.load(tmp_path / "none.npz"),
        "is not a checkpoint of this scene": lambda: water.load(__file__),
    }
    for text, call in calls.items():
        with pytest.raises(msph.MsphError) as error:
            call()
        assert text in str(error.value) and "\n" not in str(error.value)
    water.close()
    with pytest.raises(msph.MsphError, match="scene: the simulation is closed"):
        _ = water.time


def tilted(water, tilt):
    """Advances the water with a tilt, which is level again afterwards."""
    water.tilt = tilt
    try:
        next(water.frames(0.01))
    finally:
        water.tilt = (0.0, 0.0)


def test_help_lists_functions_with_units(capsys):
    import pydoc

    text = pydoc.plain(pydoc.render_doc(msph))
    for part in ("open(scene", "class Water", "push(self, force", "frames(self", "[m/s]"):
        assert part in text
