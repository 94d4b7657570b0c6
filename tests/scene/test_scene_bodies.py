"""Tests of bodies and containers in scene files: shapes, poses, motions and refused input."""

import numpy as np
import pytest
import trimesh

from msph.fluid.boundary.rigid_bodies import Ball, Block, Solid
from msph.picture.tone import CLAY, albedo
from msph.scene import SceneError, build_simulation, load_scene
from msph.scene.bodies import bodies
from msph.scene.load import to_toml
from tests.scenes_kit import CUBE

GOOD = f"""{CUBE.replace("mass = 0.3", "spacing = 0.1")}
[[bodies]]
lo = [0.2, 0.0, 0.2]
hi = [0.4, 0.6, 0.4]
"""

BAD = {
    "bodies.0.lo=[0, 0.7, 0]": "bodies.0.hi: has no volume",
    "bodies.0.radius=0.2": "bodies.0: give either lo and hi, or centre and radius, or mesh",
    "bodies.0.hi=[0.25, 1, 1]": "bodies.0: is 0.05 m thick, less than the particle spacing",
    "bodies.0.axis=[0, 0, 0]": "bodies.0.axis: has no direction",
    "bodies.0.rotation=[0, 45, 0]": "bodies.0.rotation: has no effect without mesh",
    "bodies.0.period=2.0": "bodies.0.period: has no effect without swing",
    "bodies.0.axis=[1, 0, 0]": "bodies.0.axis: has no effect without spin or angle",
    "bodies.0.release=1.0": "bodies.0.release: has no effect without density or mass",
    "bodies=[{lo=[2, 0, 0], hi=[3, 1, 1]}]": "bodies.0: is outside the box and does not move",
    "bodies=[{mesh='zz.stl'}]": "bodies.0.mesh: zz.stl: no such mesh file; shipped: ",
    "bodies=[{mesh='bowel.obj'}]": "bodies.0.mesh: bowel.obj: no such mesh file; did you "
    "mean 'bowl.obj'?",
    "bodies=[{mesh='open.ply'}]": "bodies.0.mesh: open.ply: is not closed: 9 open edges",
    "bodies=[{mesh='nan.obj'}]": "nan.obj: line 6: vertex is not finite",
    "bodies=[{mesh='text.stl'}]": "bodies.0.mesh: text.stl: ",
    "bodies=[{mesh='flat.obj'}]": "bodies.0.mesh: flat.obj: encloses no volume",
    "bodies=[{mesh='turned.obj'}]": "bodies.0.mesh: turned.obj: has no clear inside",
    "bodies=[{mesh='scene.toml'}]": "bodies.0.mesh: scene.toml: unknown mesh format",
    "bodies=[{mesh='short.ply'}]": "short.ply: declares 2000000000 faces, and holds 12",
    "bodies=[{mesh='lost.obj'}]": "lost.obj: has materials, but there is no file lost.mtl",
    "bodies=[{mesh='wrong.obj'}]": "wrong.obj: material bleu is not in paints.mtl; did you mean "
    "'blue'?",
    "bodies=[{mesh='inverted.obj'}]": "inverted.obj: body 2 of 2 is inside out",
    f"bodies=[{{mesh='{300 * 'x'}.obj'}}]": "x: no such mesh file; shipped: ",
    "container={mesh='open.ply'}": "container.mesh: open.ply: is not closed: 9 open edges",
    "bodies=[{mesh='millimetres.stl'}]": "a mesh in millimetres needs scale = 0.001",
    "container={mesh='bowl.obj'}": "container: reaches from (-0.5, 0, -0.5) m to (0.5, 0.4, 0.5) m",
    "container.scale=2.0": "container.mesh: is required",
    "bodies.0={lo=[0, 0, 0], hi=[1, 1, 1], density=500, mass=2}": "give either density or mass",
    "bodies.0={lo=[0, 0, 0], hi=[1, 1, 1], mass=2, swing=[1, 0, 0]}": "a body with a mass floats",
    "bodies.0={lo=[-1, 0, 0], hi=[0.5, 1, 1], mass=2}": "floats, and must start inside the box",
    "bodies.0={lo=[0, 0, 0], hi=[1, 1, 1], mass=2, angle=4}": "give either density or mass, or",
    "bodies.0={lo=[0, 0, 0], hi=[1, 1, 1], spin=2, angle=4}": "give either velocity, swing or spin",
    "bodies.0.displacement=[0, 'u', 0]": "bodies.0.displacement.1: unknown name 'u'",
    "bodies.0.angle='1 / (t - 10)'": "bodies.0.angle: '1 / (t - 10)' is not a number at t = 10 s",
    "bodies.0.displacement=['1e4 * t', 0, 0]": "bodies.0: its surface moves at 1e+04 m/s",
    "method=classic": "bodies: the method classic has no bodies; projection has",
    "bodies.0.colour=[255, 0, 0]": "bodies.0.colour.0: input should be less than or equal to 1",
    "bodies.0.velocty=[1, 0, 0]": "bodies.0.velocty: unknown key; did you mean 'velocity'?",
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Returns a folder with a scene and with valid and invalid mesh files."""
    path = tmp_path_factory.mktemp("bodies")
    (path / "scene.toml").write_text(GOOD)
    trimesh.creation.box((1.0, 2.0, 3.0)).export(path / "brick.stl")
    ball = trimesh.creation.icosphere(1)
    ball.faces = ball.faces[3:]
    ball.export(path / "open.ply")
    box = trimesh.creation.box()
    box.faces[0] = box.faces[0][::-1]
    box.export(path / "turned.obj")
    flat = trimesh.creation.box((1.0, 1.0, 1e-9))
    flat.merge_vertices(digits_vertex=12)
    flat.export(path / "flat.obj", digits=12)
    trimesh.creation.box((200.0, 200.0, 200.0)).export(path / "millimetres.stl")
    ball = trimesh.creation.icosphere(2, radius=0.1)
    beside = ball.copy().apply_translation((0.07, 0.0, 0.0))
    trimesh.util.concatenate([ball, beside]).export(path / "crossing.obj")
    (path / "text.stl").write_text("no mesh at all\n")
    brick = trimesh.creation.box((0.4, 0.2, 0.4)).export(file_type="obj")
    (path / "old.obj").write_bytes(b"# caf\xe9\n" + brick.encode())
    box = trimesh.creation.box((0.4, 0.2, 0.4))
    text = box.export(file_type="ply", encoding="ascii")
    (path / "old.ply").write_bytes(text.replace(b"\nelement", b"\ncomment caf\xe9\nelement", 1))
    (path / "short.ply").write_bytes(text.replace(b"face 12", b"face 2000000000"))
    text = box.export(file_type="stl_ascii").encode()
    (path / "old.stl").write_bytes(text.replace(b"solid", b"solid caf\xe9", 1))
    inside_out = box.copy()
    inside_out.invert()
    inside_out.export(path / "inside_out.obj")
    inner = trimesh.creation.box((0.2, 0.1, 0.2))
    inner.invert()
    trimesh.util.concatenate([box, inner]).export(path / "hollow.obj")
    inner.apply_translation((0.6, 0.0, 0.0))
    trimesh.util.concatenate([box, inner]).export(path / "inverted.obj")
    head, *lines = [line for line in brick.splitlines() if line[:2] in ("v ", "f ")]
    painted = "\n".join(["mtllib paints.mtl", head, *lines[:-6], "usemtl red", *lines[-6:-1]])
    painted += f"\nusemtl blue\n{lines[-1]}\n"
    (path / "painted.obj").write_text(painted)
    (path / "paints.mtl").write_text("newmtl red\nKd 1 0 0\nnewmtl blue\nKd 0 0.2 0.4\n")
    (path / "wrong.obj").write_text(painted.replace("usemtl blue", "usemtl bleu"))
    (path / "lost.obj").write_text(painted.replace("paints", "lost"))
    (path / "plain.obj").write_text(painted.replace("mtllib paints.mtl", ""))
    for kind in ("face", "vertex"):
        box = trimesh.creation.box((0.4, 0.2, 0.4))
        setattr(
            box.visual,
            f"{kind}_colors",
            np.tile((255, 128, 5, 255), (12, 1))[: 8 + 4 * (kind == "face")],
        )
        box.export(path / f"{kind}.ply")
    (path / "nan.obj").write_text(brick.replace("v 0.20000000", "v nan", 1))
    return path


def load(folder, *overrides):
    return load_scene(str(folder / "scene.toml"), overrides)


@pytest.mark.parametrize(
    ("name", "size", "volume"),
    [
        # Text with bytes that are not UTF-8. Regression: "No module named 'charset_normalizer'".
        *((f"old.{kind}", (0.4, 0.2, 0.4), 0.032) for kind in ("obj", "ply", "stl")),
        ("hollow.obj", (0.4, 0.2, 0.4), 0.032 - 0.004),  # has a cavity
        ("crossing.obj", (0.27, 0.2, 0.2), None),  # intersects itself
        ("inside_out.obj", (0.4, 0.2, 0.4), 0.032),  # faces of an inverted mesh are flipped
    ],
)
def test_unusual_meshes_are_accepted(folder, name, size, volume):
    (solid,) = bodies(load(folder, f"bodies=[{{mesh='{name}', position=[0.5, 0.3, 0.5]}}]"))
    assert solid.bounds[1] - solid.bounds[0] == pytest.approx(size, rel=0.02)
    if volume:
        corners = solid.vertices[solid.triangles]
        assert np.linalg.det(corners).sum() / 6.0 == pytest.approx(volume)


@pytest.mark.parametrize("override", BAD)
def test_bad_bodies_give_one_line_with_their_key(folder, override):
    with pytest.raises(SceneError) as error:
        load(folder, override)
    line = str(error.value)
    assert BAD[override] in line and "\n" not in line


def test_wave_makers_count_as_bodies(folder):
    """Regression: 64 bodies and two wave makers ended in an unexpected error."""
    balls = ", ".join(64 * ["{centre=[0.5, 0.5, 0.5], radius=0.15}"])
    makers = ", ".join(f"{{end='{end}', stroke=0.1, period=1.0}}" for end in ("-x", "+x"))
    with pytest.raises(SceneError, match="wavemakers: make 66 bodies .* at most 65"):
        load(folder, f"bodies=[{balls}]", f"wavemakers=[{makers}]")


def test_bodies_have_the_shapes_and_poses_of_the_scene(folder):
    scene = load(
        folder,
        "bodies=[{lo=[0, 0, 0], hi=[0.5, 0.2, 0.3], swing=[0.1, 0, 0]}, "
        "{centre=[0.5, 0.5, 0.5], radius=0.2}, "
        "{mesh='brick.stl', scale=0.2, rotation=[0, 0, 90], position=[0.5, 0.5, 0.5], spin=90}]",
    )
    block, ball, brick = bodies(scene)
    assert isinstance(block, Block) and isinstance(ball, Ball) and isinstance(brick, Solid)
    assert block.motion.offset(0.5) == pytest.approx((0.1, 0.0, 0.0))
    # Edges of 1 x 2 x 3, scaled by 0.2; the rotation turns the long edges to x and z.
    assert brick.bounds[1] - brick.bounds[0] == pytest.approx((0.4, 0.2, 0.6))
    assert 0.5 * (brick.bounds[1] + brick.bounds[0]) == pytest.approx((0.5, 0.5, 0.5))
    # A quarter turn about y rotates z to x.
    assert brick.motion.rotation(1.0) @ (0.0, 0.0, 1.0) == pytest.approx((1.0, 0.0, 0.0), abs=1e-12)


def test_bodies_follow_expressions_of_the_time(folder):
    scene = load(
        folder,
        "bodies=[{lo=[0, 0, 0.2], hi=[0.5, 0.2, 0.4], displacement=[0, 't^2', 0]}, "
        "{centre=[0.5, 0.5, 0.5], radius=0.2, axis=[0, 0, 1], angle='90 * t'}]".replace("^", "**"),
        "duration=2.0",
    )
    gate, ball = bodies(scene)
    assert gate.motion.offset(1.5) == pytest.approx((0.0, 2.25, 0.0))
    assert gate.motion.slides.tolist() == [False, True, False] and not gate.motion.spins
    assert gate.motion.top_speed(1.0) == pytest.approx(4.0, rel=0.01)
    assert ball.motion.rotation(1.0) @ (1.0, 0.0, 0.0) == pytest.approx((0.0, 1.0, 0.0), abs=1e-9)
    assert ball.motion.top_speed(0.2) == pytest.approx(0.1 * np.pi)


def test_saved_scene_finds_its_mesh_from_another_folder(folder, tmp_path, monkeypatch):
    scene = load(folder, "bodies=[{mesh='brick.stl', scale=0.2}]")
    (tmp_path / "again.toml").write_text(to_toml(scene, "quality large"))
    monkeypatch.chdir(tmp_path)
    assert load_scene("again.toml") == scene


def test_water_inside_bodies_is_left_out_and_counted(folder):
    sim = build_simulation(load(folder))
    # The lattice has 10 x 5 x 10 sites, of which 2 x 5 x 2 are inside the block.
    assert sim.left_out == 20 and sim.particles.count == 480
    x = sim.particles.numpy("x")
    assert not ((x > (0.2, -1.0, 0.2)) & (x < (0.4, 0.6, 0.4))).all(axis=1).any()


def test_bodies_that_leave_no_water_are_refused(folder):
    scene = load(folder, "bodies.0.lo=[0, 0, 0]", "bodies.0.hi=[1, 1, 1]")
    with pytest.raises(SceneError, match="bodies: no water is left outside the bodies"):
        build_simulation(scene)


def test_an_open_box_around_a_container_is_refused():
    with pytest.raises(SceneError, match="box.open: has no effect: no water leaves a container"):
        load_scene("bowl", ("box.open=true",))


def test_triangles_have_the_colours_of_their_materials(folder):
    """Triangles before the first material are clay, `colour` replaces all colours, and an .obj file
    without a library has none."""

    def paint(name, more=""):
        override = f"bodies=[{{mesh='{name}', position=[0.5, 0.3, 0.5]{more}}}]"
        return bodies(load(folder, override))[0].paint

    colours, counts = np.unique(paint("painted.obj"), axis=0, return_counts=True)
    assert colours == pytest.approx(np.array([(0.0, 0.2, 0.4), CLAY, (1.0, 0.0, 0.0)]), abs=0.002)
    assert list(counts) == [1, 6, 5]
    assert paint("painted.obj", ", colour=[0, 1, 0]") is None and paint("plain.obj") is None
    for name in ("face.ply", "vertex.ply"):
        expected = np.tile(albedo(np.array((255, 128, 5)) / 255), (12, 1))
        assert paint(name) == pytest.approx(expected)


def test_the_colour_of_a_body_is_its_albedo_in_srgb(folder):
    """The middle grey of sRGB reflects 21.4 % of the light (IEC 61966-2-1)."""
    scene = load(folder, "bodies.0.colour=[1.0, 0.5, 0.02]")
    assert bodies(scene)[0].albedo == pytest.approx((1.0, 0.21404, 0.02 / 12.92), rel=1e-4)
