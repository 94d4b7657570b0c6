"""Tests of recordings: every kind of file, interrupts, and refused outputs."""

import errno
import signal
import sys
from pathlib import Path
from xml.etree import ElementTree

import imageio.v2 as imageio
import meshio
import numpy as np
import pytest
import trimesh
from PIL import Image

from msph.export import usd
from msph.export.files import write_particles
from msph.export.outputs import Outputs, check_outputs
from msph.export.video import check_video, video_writer
from msph.export.vtu import write_bodies
from msph.fluid.boundary.rigid_bodies import Ball
from msph.measure.body_table import BodyTable
from msph.measure.host_kernels import wendland
from msph.own_files import OutputError
from msph.scene import load_scene
from msph.scene.parts import with_value
from msph.stage.loop import run
from msph.stage.recorder import LostOutputError, Recorder
from msph.stage.row import Row
from msph.stage.show import SIMULATED, Show
from tests.command_kit import done, here, started
from tests.fluid.fluid_kit import poly6
from tests.scenes_kit import LAYERED, POOL, WATER, load, write

SIZE = (163, 91)
FPS = 30.0


# The next tests run before `show` is built, and use its fields.
def test_vtu_bodies_have_their_motion_and_the_forces_of_the_water(tmp_path):
    show = Show(load(tmp_path, POOL + WATER + BODIES), 1 / FPS)
    boundary, frames = show.simulation.boundary, 4
    run(Row([show]), Recorder(Outputs(bodies=[tmp_path / "b_%d.vtu"]), frames, FPS, bar=False))
    files = [meshio.read(tmp_path / f"b_{k}.vtu") for k in range(frames)]
    owner, impulse = files[0].point_data["body"], np.zeros((2, 3))
    for found in files:
        impulse += [found.point_data["force_N"][owner == b][0] / FPS for b in (0, 1)]
    assert impulse == pytest.approx(boundary.impulse, rel=1e-4, abs=1e-5)
    for b in (0, 1):
        last, mine = files[-1].point_data, owner == b
        assert files[-1].points[mine].mean(axis=0) == pytest.approx(boundary.centre_at_end(b))
        assert np.ptp(last["position_m"][mine], axis=0) == pytest.approx(np.zeros(3))
        moved = FPS * (files[-1].points - files[-2].points)[mine]
        mean = 0.5 * (last["velocity_m_per_s"] + files[-2].point_data["velocity_m_per_s"])[mine]
        assert np.abs(moved - mean).max() < 0.1 * np.abs(moved).max()
    assert last["rotation_rad"][owner == 1][0, 1] == pytest.approx(np.pi / 2 * 4 / FPS, rel=0.1)
    # The table has columns only for the bodies of the scene.
    table = BodyTable(show.simulation)
    width = len(table.row(0.0))
    show.simulation.add_body(Ball(np.array((0.28, 0.33, 0.2)), 0.05, mass=0.1), show.gravity())
    assert len(table.row(0.1)) == width == 1 + 2 * 18
    write_bodies(tmp_path / "more.vtu", show.simulation, table.numbers(0.2))
    assert set(meshio.read(tmp_path / "more.vtu").point_data["body"]) == {0, 1, 2}
    show.close()


def test_a_checkpoint_with_added_water_is_resumed(tmp_path):
    """Regression: the checkpoint had more particles than the scene has room for."""
    scene = write(tmp_path, POOL + LAYERED)
    show = Show(load_scene(scene), 1 / FPS, **SIMULATED)
    room, size = show.simulation.plan.initial["x"].shape[0], np.array(show.simulation.size)
    sites = np.stack(np.meshgrid(*[np.arange(1, 9) / 9 * s for s in size]), axis=-1).reshape(-1, 3)
    finest = show.simulation.layers.finest_index
    show.simulation.add(sites, np.zeros_like(sites), finest, show.gravity())
    assert show.simulation.particles.count > room
    write_particles(tmp_path / "full.npz", show)
    show.close()
    arguments = scene, "--resume", tmp_path / "full.npz"
    files = "--particles", tmp_path / "p_%d.npz", "--seconds", "0.1", "--fps", "20"
    done("capture", *arguments, *files)
    done("measure", *arguments, "-o", tmp_path / "measured", "--seconds", "0.05")


@pytest.fixture(scope="module")
def show(tmp_path_factory):
    scene = load(tmp_path_factory.mktemp("scene"))
    show = Show(scene, 1.0 / FPS, size=SIZE, meshes=True)
    yield show
    show.close()


@pytest.fixture(scope="module")
def recorded(show, tmp_path_factory):
    """Returns a folder with four frames in every kind of file, recorded in one run."""
    folder = tmp_path_factory.mktemp("recorded")
    names = (
        ["a.mp4", "a.webm", "a.gif", "a.webp", "last.png", "f_%04d.png"],
        ["m_%04d.ply", "m_%04d.obj", "m_%04d.vtu"],
        ["p_%04d.csv", "p_%04d.npz", "p_%04d.vtu"],
    )
    show.reset()
    outputs = Outputs(*([folder / name for name in kind] for kind in names))
    run(Row([show]), Recorder(outputs, 4, FPS, bar=False))
    return folder


def test_images_have_an_alpha_channel_if_the_scene_sets_it(show, tmp_path, monkeypatch):
    monkeypatch.setattr(show, "scene", with_value(show.scene, "picture.alpha", True))
    outputs = Outputs([tmp_path / name for name in ("a.webm", "a.webp", "a.png")])
    check_outputs(outputs, FPS, alpha=True)
    show.reset()
    run(Row([show]), Recorder(outputs, 2, FPS, bar=False))
    for name in ("a.webp", "a.png"):
        pixels = np.asarray(Image.open(tmp_path / name))
        opacity = pixels[..., 3]
        # The corners show sky and ground, the middle shows tiles and water.
        assert opacity[0, 0] == opacity[-1, -1] == 0
        assert (opacity[30:60, 60:100] > 200).mean() > 0.9
        assert 0.1 < (opacity > 128).mean() < 0.9
    reader = imageio.get_reader(tmp_path / "a.webm", input_params=["-c:v", "libvpx-vp9"])
    assert reader.get_meta_data()["pix_fmt"].startswith("yuva420p")
    for name in ("a.mp4", "a.gif"):
        with pytest.raises(OutputError, match=r"no alpha channel .*\.webm"):
            check_outputs(Outputs([tmp_path / name]), FPS, alpha=True)


@pytest.mark.parametrize("name", ["a.mp4", "a.webm", "a.gif"])
def test_video_plays_back_every_frame(recorded, name):
    reader = imageio.get_reader(recorded / name)
    frames = [frame for frame in reader.iter_data()]
    assert len(frames) == 4
    even = (SIZE[1] // 2 * 2, SIZE[0] // 2 * 2)
    assert frames[0].shape[:2] == (SIZE[::-1] if name.endswith("gif") else even)
    assert frames[0].std() > 5.0
    if name.endswith("gif"):
        with Image.open(recorded / name) as gif:
            times = [gif.seek(k) or gif.info["duration"] for k in range(gif.n_frames)]
        assert sum(times) == pytest.approx(1000.0 * 4 / FPS, abs=10.0)


def test_still_is_the_last_image_of_the_sequence(recorded):
    files = sorted(recorded.glob("f_*.png"))
    assert [f.name for f in files] == [f"f_{k:04d}.png" for k in range(4)]
    assert np.array_equal(imageio.imread(recorded / "last.png"), imageio.imread(files[-1]))
    assert not np.array_equal(imageio.imread(files[0]), imageio.imread(files[-1]))


def test_tables_contain_every_particle(recorded, show):
    lines = (recorded / "p_0003.csv").read_text().splitlines()
    assert lines[0].startswith("x_x_m,x_y_m,x_z_m,v_x_m_per_s")
    assert len(lines) == 1 + sum(show.counts)
    with np.load(recorded / "p_0003.npz") as state:
        assert len(state["x"]) == sum(show.counts)
        assert state["time"] == pytest.approx(4 / FPS)


def test_vtu_particles_agree_with_the_checkpoint(recorded, show):
    """The particles have the values of the checkpoint in SI units, each name includes its unit, and
    solver residuals are measured at the current positions."""
    found = meshio.read(recorded / "p_0003.vtu")
    assert {cells.type for cells in found.cells} == {"vertex"}
    arrays = found.point_data
    with np.load(recorded / "p_0003.npz") as state:
        assert np.array_equal(found.points, state["x"])
        assert np.array_equal(arrays["velocity_m_per_s"], state["v"])
        assert np.array_equal(arrays["layer"], state["layer"])
        assert np.allclose(arrays["pressure_Pa"], state["pressure"])
        specs = show.simulation.layers.specs
        assert np.allclose(arrays["spacing_m"], [specs[k].spacing for k in state["layer"]])
        density = reference_density(state, [specs[k] for k in state["layer"]])
    assert np.allclose(arrays["solver_residual"], density / 1000.0 - 1.0, atol=1e-3)


@pytest.mark.parametrize("name", ["p", "m"])
def test_paraview_files_contain_the_simulated_time(recorded, name):
    """Regression: ParaView showed frame numbers as times."""
    root = ElementTree.parse(recorded / f"{name}.pvd").getroot()
    listed = {d.get("file"): float(d.get("timestep")) for d in root.iter("DataSet")}
    assert listed == {f"{name}_{k:04d}.vtu": pytest.approx((k + 1) / FPS) for k in range(4)}
    array = ElementTree.parse(recorded / f"{name}_0003.vtu").find(".//FieldData/DataArray")
    assert array.get("Name") == "TimeValue" and float(array.text) == pytest.approx(4 / FPS)


def reference_density(state, specs):
    """Returns the density [kg/m^3] by Eq. 26, summed by brute force with poly6 over all pairs."""
    x, m = state["x"].astype(float), np.array([s.mass for s in specs])
    h = np.array([s.support for s in specs])
    r = np.linalg.norm(x[:, None] - x, axis=2)
    return (m * poly6(r, h)).sum(axis=1)


def test_vtu_surface_has_the_values_of_the_particles(recorded, show):
    """Means over all particles, weighted by volume and kernel, here by brute force."""
    found, mesh = meshio.read(recorded / "m_0003.vtu"), trimesh.load(recorded / "m_0003.ply")
    assert found.points == pytest.approx(mesh.vertices, abs=1e-6)
    assert np.array_equal(found.cells_dict["triangle"], mesh.faces)
    water, some = meshio.read(recorded / "p_0003.vtu"), slice(0, None, 7)
    data, here = water.point_data, {k: v[some] for k, v in found.point_data.items()}
    r = np.linalg.norm(found.points[some, None] - water.points, axis=2)
    supports = np.array([s.support for s in show.simulation.layers.specs])
    weight = data["spacing_m"] ** 3 * wendland(r, supports[data["layer"]])
    weight /= weight.sum(axis=1, keepdims=True)
    for name in ("velocity_m_per_s", "pressure_Pa", "solver_residual"):
        scale = np.abs(data[name]).max()
        assert np.allclose(here[name], weight @ data[name], atol=1e-4 * scale)
    assert np.array_equal(here["layer"], data["layer"][r.argmin(axis=1)])


BODIES = """
[[bodies]]
lo = [0.05, 0.05, 0.1]
hi = [0.15, 0.15, 0.3]
swing = [0, 0.1, 0]
period = 0.5
[[bodies]]
centre = [0.28, 0.2, 0.2]
radius = 0.06
density = 400
spin = 90
"""


def test_output_of_bodies_is_refused_in_a_scene_without_bodies(tmp_path):
    found = here("capture", write(tmp_path), "--bodies", tmp_path / "b_%d.vtu")
    assert found.returncode == 2 and "the scene has no bodies" in found.stderr


def test_usd_files_are_refused_without_usd_core(tmp_path, monkeypatch):
    monkeypatch.setattr(usd, "available", lambda: False)
    with pytest.raises(OutputError, match=r"a.usda: needs usd-core: pip install usd-core"):
        check_outputs(Outputs(usd=[tmp_path / "a.usda"]), FPS)


@pytest.mark.parametrize(
    ("kind", "names", "fps", "message"),
    [
        ("meshes", ["m.ply"], FPS, "needs a frame number"),
        ("pictures", ["a_%03d.mp4"], FPS, "needs no frame number"),
        ("pictures", ["a_%02d_%02d.png"], FPS, "more than one frame number"),
        ("pictures", ["a.gif"], 60.0, "at most 50 frames per second"),
    ],
)
def test_impossible_outputs_are_refused(tmp_path, kind, names, fps, message):
    with pytest.raises(OutputError, match=message):
        check_outputs(Outputs(**{kind: [tmp_path / name for name in names]}), fps)


@pytest.mark.skipif(sys.platform == "win32", reason="file names have no colons")
@pytest.mark.parametrize("name", ["run:1.mp4", "pipe:1.mp4", "http:a.webm"])
def test_a_video_may_be_named_like_an_address(tmp_path, monkeypatch, name):
    """Regression: the video was reported as empty."""
    monkeypatch.chdir(tmp_path)
    with video_writer(Path(name), FPS) as writer:
        for _ in range(3):
            writer.append_data(np.zeros((16, 16, 3), np.uint8))
    check_video(Path(name), 3)
    assert [path.name for path in tmp_path.iterdir()] == [name]


def test_an_incomplete_video_is_reported(recorded, tmp_path):
    cut = tmp_path / "cut.mp4"
    cut.write_bytes((recorded / "a.mp4").read_bytes()[:1000])
    with pytest.raises(OSError, match="the encoder wrote 0 of 4 frames"):
        check_video(cut, 4)
    check_video(recorded / "a.mp4", 4)


def test_a_full_disk_gives_one_line_and_lost_files_are_not_listed(show, tmp_path, monkeypatch):
    video, still = tmp_path / "a.mp4", tmp_path / "s.png"
    recorder = Recorder(Outputs([video, still]), 2, FPS, bar=False)

    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("msph.stage.recorder.imageio.imwrite", full)
    show.reset()
    with pytest.raises(LostOutputError, match=r"s\.png: no space left on device"):
        run(Row([show]), recorder)
    assert recorder.kept() == [video]


@pytest.mark.skipif(sys.platform == "win32", reason="sends an interrupt")
def test_an_interrupt_leaves_playable_files(tmp_path):
    """Regression: an interrupt within a write killed the encoder."""
    targets = [tmp_path / "cut.mp4", tmp_path / "cut.gif"]
    command = ["capture", write(tmp_path), "-o", targets[0], "-o", targets[1], "--seconds", "4"]
    process = started(*command, "--size", "64x36", "--arch", "cpu", start_new_session=True)
    try:
        # The command prints a line per tenth of the run.
        for line in process.stderr:
            if line.startswith("10 %"):
                break
        process.send_signal(signal.SIGINT)
        rest = process.communicate(timeout=60)[1]
    finally:
        process.kill()
    assert process.returncode == 128 + signal.SIGINT
    assert "stopped after" in rest and "msph: interrupted" in rest
    for target in targets:
        assert sum(1 for _ in imageio.get_reader(target)) > 1
    assert (Path(tmp_path) / "cut.scene.toml").exists()
