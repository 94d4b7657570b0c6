"""Tests of files for other programs: meshes, droplets and bodies as PLY, OBJ and USD."""

import numpy as np
import pytest
import trimesh

import msph
from msph.export.files import write_mesh
from msph.measure.table import read
from msph.scene.meshes import load_mesh

# Water that falls on a floating ball, so that there are spray, a body in motion and foam.
SCENE = {
    "box": {"size": (0.5, 0.5, 0.5), "open": True},
    "layers": [{"spacing": 0.03}],
    "water": [
        {"lo": (0, 0, 0), "hi": (0.5, 0.12, 0.5)},
        {"centre": (0.3, 0.35, 0.25), "radius": 0.06, "velocity": (1, -4, 0)},
    ],
    "bodies": [
        {"name": "ball", "centre": (0.15, 0.2, 0.25), "radius": 0.06, "density": 400},
        {"mesh": "duck.obj", "scale": 0.15, "position": (0.35, 0.05, 0.25)},
    ],
    "sway": {"angle": 5, "period": 0.5},
}
FRAMES = 5


@pytest.fixture(scope="module")
def water():
    with msph.open(SCENE) as found:
        *_, _ = found.frames(seconds=0.25)
        yield found


@pytest.fixture(scope="module")
def folder(water, tmp_path_factory):
    """A folder with the files of FRAMES frames, made with and without droplets."""
    folder = tmp_path_factory.mktemp("files")
    water.save(folder / "start.npz")
    files = {"meshes": [folder / "m_%d.ply", folder / "m_%d.obj"], "bodies": folder / "b.obj"}
    water.record(seconds=FRAMES / 30, **files)
    water.load(folder / "start.npz")
    spray = {"meshes": folder / "n_%d.ply", "droplets": [folder / "d_%d.ply", folder / "d_%d.vtu"]}
    water.record(seconds=FRAMES / 30, **spray)
    return folder


def test_a_ply_mesh_has_the_velocity_and_the_foam_of_its_vertices(folder, water):
    mesh = trimesh.load(folder / "m_4.ply", process=False)
    given = mesh.metadata["_ply_raw"]["vertex"]["data"]
    assert mesh.is_watertight and mesh.volume == pytest.approx(0.12 * 0.25, rel=0.2)
    velocity = np.column_stack([given[f"velocity_{k}"] for k in "xyz"])
    speeds = np.linalg.norm(velocity, axis=1)
    assert 0.0 < speeds.max() <= 1.01 * np.linalg.norm(water.frame.particles.v, axis=1).max() + 1.0
    assert np.all((given["foam"] >= 0.0) & (given["foam"] <= 1.0)) and given["foam"].max() > 0.0


@pytest.mark.parametrize("suffix", [".ply", ".obj"])
def test_an_exported_mesh_is_read_back_unchanged(water, tmp_path, suffix):
    mesh, path = water.mesh(), tmp_path / f"water{suffix}"
    write_mesh(path, water._awake)
    found = trimesh.load(path, process=False, maintain_order=True)
    assert np.allclose(found.vertices, mesh.vertices, atol=1e-6)
    assert np.array_equal(found.faces, mesh.faces)
    assert np.allclose(found.vertex_normals, mesh.vertex_normals, atol=1e-3)
    assert found.volume == pytest.approx(mesh.volume, rel=1e-5)


def test_an_obj_mesh_has_them_in_place_of_colours_and_texture_coordinates(folder):
    ply = trimesh.load(folder / "m_4.ply", process=False)
    given = ply.metadata["_ply_raw"]["vertex"]["data"]
    lines = (folder / "m_4.obj").read_text().splitlines()
    rows = {
        k: np.array([line.split()[1:] for line in lines if line.startswith(f"{k} ")], float)
        for k in ("v", "vt", "vn")
    }
    assert rows["v"][:, :3] == pytest.approx(ply.vertices, abs=1e-6)
    assert rows["v"][:, 3] == pytest.approx(given["velocity_x"], abs=1e-5)
    assert rows["vt"][:, 0] == pytest.approx(given["foam"], abs=1e-6)
    assert len(trimesh.load(folder / "m_4.obj").faces) == len(ply.faces)


def test_droplets_have_the_volume_that_the_mesh_lacks(folder):
    import meshio

    for frame in range(FRAMES):
        with_spray, without = (
            trimesh.load(folder / f"{k}_{frame}.ply", process=False) for k in "mn"
        )
        drops = trimesh.load(folder / f"d_{frame}.ply", process=False)
        radius = drops.metadata["_ply_raw"]["vertex"]["data"]["radius"]
        assert len(radius) and np.all(radius >= 0.0)
        volume = 4.0 / 3.0 * np.pi * float((radius.astype(float) ** 3).sum())
        # Within the volume control of each surface, and bodies are not cut out of the second.
        assert volume < 0.05 * with_spray.volume and without.volume > 0.8 * with_spray.volume
        points = meshio.read(folder / f"d_{frame}.vtu")
        assert points.point_data["radius_m"] == pytest.approx(radius)


def test_bodies_are_one_obj_file_with_a_transform_per_frame(folder, water):
    assert (folder / "b.obj").read_text().count("\no ") == 2
    assert "newmtl ball" in (folder / "b.mtl").read_text()
    table = read(folder / "b.csv")
    last = (table["frame"] == FRAMES - 1) & (table["body"] == 0)
    matrix = np.array([table[f"m{r}{c}"][last][0] for r in range(3) for c in range(4)])
    turn, shift = matrix.reshape(3, 4)[:, :3], matrix.reshape(3, 4)[:, 3]
    assert turn @ turn.T == pytest.approx(np.eye(3), abs=1e-6)
    moved = turn @ SCENE["bodies"][0]["centre"] + shift
    assert moved == pytest.approx(water.bodies["ball"].position, abs=1e-4)


def test_bodies_keep_the_materials_of_their_mesh(folder):
    text = (folder / "b.obj").read_text()
    own = [part.split()[0] for part in text.split("usemtl ")[1:]]
    assert own == ["ball", "bodies.1", "bodies.1_1", "bodies.1_2"]
    scene = trimesh.load(folder / "b.obj", force="scene")
    counts = {
        tuple(part.visual.material.main_color[:3]): len(part.faces)
        for part in scene.geometry.values()
    }
    colours, faces = np.unique(load_mesh("duck.obj")[2], axis=0, return_counts=True)
    for colour, count in zip(colours, faces, strict=True):
        assert counts[tuple((255 * colour).round().astype(int))] == count


def test_a_usd_film_has_all_samples_and_the_camera_sees_what_the_image_shows(water, tmp_path):
    pxr = pytest.importorskip("pxr")
    from pxr import Usd, UsdGeom

    assert pxr
    path = tmp_path / "film.usda"
    water.record(seconds=FRAMES / 30, usd=path, size=(160, 90))
    stage = Usd.Stage.Open(str(path))
    assert UsdGeom.GetStageUpAxis(stage) == "Y" and UsdGeom.GetStageMetersPerUnit(stage) == 1.0
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (0.0, FRAMES - 1.0)
    assert stage.GetTimeCodesPerSecond() == 30.0
    mesh, points = (
        UsdGeom.Mesh.Get(stage, "/Tank/Water"),
        UsdGeom.Points.Get(stage, "/Tank/Droplets"),
    )
    assert mesh.GetPointsAttr().GetNumTimeSamples() == FRAMES
    n = len(mesh.GetPointsAttr().Get(FRAMES - 1))
    assert len(mesh.GetVelocitiesAttr().Get(FRAMES - 1)) == n
    assert len(UsdGeom.PrimvarsAPI(mesh).GetPrimvar("foam").Get(FRAMES - 1)) == n
    assert max(mesh.GetFaceVertexIndicesAttr().Get(FRAMES - 1)) < n
    assert len(points.GetWidthsAttr().Get(2)) == len(points.GetPointsAttr().Get(2)) > 0
    ball = UsdGeom.Xformable(stage.GetPrimAtPath("/Tank/Bodies/ball"))
    local = ball.GetLocalTransformation(FRAMES - 1)
    moved = local.Transform(tuple(map(float, SCENE["bodies"][0]["centre"])))
    assert np.array(moved) == pytest.approx(water.bodies["ball"].position, abs=1e-4)
    # The centre of the box is in the middle of the image, along the camera's axis.
    camera = UsdGeom.Camera.Get(stage, "/Camera")
    view = camera.GetCamera(0.0).frustum.ComputeViewMatrix()
    assert np.array(view.Transform((0.25, 0.25, 0.25)))[:2] == pytest.approx([0, 0], abs=1e-6)
    duck = UsdGeom.Mesh.Get(stage, "/Tank/Bodies/bodies_1")
    number = len(duck.GetFaceVertexCountsAttr().Get())
    assert len(duck.GetDisplayColorAttr().Get()) == number
    parts = UsdGeom.Subset.GetAllGeomSubsets(duck)
    assert len(parts) == 3 and sum(len(p.GetIndicesAttr().Get()) for p in parts) == number
    fov = camera.GetCamera(0.0).GetFieldOfView(camera.GetCamera(0.0).FOVVertical)
    assert fov == pytest.approx(water.scene.camera.fov, abs=1e-3)


def test_a_usd_film_without_droplets_has_a_point_of_no_width(water, tmp_path, monkeypatch):
    """Regression: Blender 5.0 crashed on points without a point."""
    pytest.importorskip("pxr")
    from pxr import Usd, UsdGeom

    none = np.zeros((0, 3)), np.zeros(0), np.zeros((0, 3))
    monkeypatch.setattr(water._show.display.surface.thin.spray, "droplets", lambda: none)
    water.record(seconds=1 / 30, usd=tmp_path / "film.usda", size=(160, 90))
    stage = Usd.Stage.Open(str(tmp_path / "film.usda"))
    points = UsdGeom.Points.Get(stage, "/Tank/Droplets")
    assert list(points.GetWidthsAttr().Get(0)) == [0.0]
    assert len(points.GetPointsAttr().Get(0)) == len(points.GetVelocitiesAttr().Get(0)) == 1
