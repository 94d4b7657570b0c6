"""Tests of loading scenes: valid scenes load, invalid ones give an error of one line."""

import pytest

from msph.scene import SceneError, load_scene
from msph.scene.check import cautions, views
from msph.scene.effort import effort
from msph.scene.library import shipped_scenes
from msph.scene.load import parse_override, to_toml
from msph.scene.parameters import parameters
from msph.scene.schema import Scene
from msph.scene.water import initial_particles, layer_specs, specified_mass

GOOD = """
[box]
size = [1.0, 1.0, 1.0]
[[layers]]
mass = 0.3
[[layers]]
spacing = 0.1
[[water]]
lo = [0, 0, 0]
hi = [1, 0.5, 1]
"""

BAD = {
    "top-level key in a table": (
        "[classic]\nduration = 2.0\n",
        "classic.duration: unknown key; 'duration' is a key of the whole file, not of this table",
    ),
    "misspelt key": ("[clasic]\nstiffness = 1.0\n", "clasic: unknown key; did you mean 'classic'?"),
    "misspelt inner key": (
        "[classic]\nstifness = 1.0\n",
        "classic.stifness: unknown key; did you mean 'stiffness'?",
    ),
    "wrong type": ('duration = "long"\n', "duration: input should be a valid number (got 'long')"),
    "integer for text": ("title = 3\n", "title: input should be a valid string (got 3)"),
    "out of range": ("duration = -1\n", "duration: input should be greater than 0 (got -1)"),
    "not a number": ("duration = nan\n", "duration: input should be a finite number (got nan)"),
    "unknown method": (
        'method = "magic"\n',
        "method: input should be 'classic' or 'projection' (got 'magic')",
    ),
    "probe without its key": (
        '[[probes]]\nname = "a"\nkind = "height"\n',
        "probes.0: a height probe needs at",
    ),
    "probe with another's key": (
        '[[probes]]\nname = "a"\nkind = "front"\naxis = "+x"\npoint = [0, 0, 0]\n',
        "probes.0.point: is not a key of front probes, which need axis",
    ),
    "variants that are none": ("variants = 3\n", "variants: is not a table of variants (got 3)"),
    "an integer of thousands of digits": (
        f"seed = {'9' * 5000}\n",
        "is not TOML: Exceeds the limit",
    ),
    "arrays thousands deep": (
        f"title = {'[' * 5000}{']' * 5000}\n",
        "is not TOML: maximum recursion",
    ),
    "probe of half a rectangle": (
        '[[probes]]\nname = "a"\nkind = "pressure"\nlo = [0.5, 0, 0]\n',
        "probes.0: a pressure probe needs point or lo and hi",
    ),
    "flux through a box": (
        '[[probes]]\nname = "a"\nkind = "flux"\nlo = [0.5, 0, 0]\nhi = [0.6, 0.2, 1]\n',
        "probes.0.hi: must equal lo on one axis and exceed it on the others, to form a rectangle",
    ),
    "force on a body that there is not": (
        '[[probes]]\nname = "a"\nkind = "force"\nbody = "bodies.0"\n',
        "probes.0.body: the scene has no body bodies.0; known: none",
    ),
    "window of a probe that has none": (
        '[[probes]]\nname = "a"\nkind = "front"\naxis = "+x"\nwindow = 0.1\n',
        "probes.0.window: is a key of pressure probes only",
    ),
    "probe outside the box": (
        '[[probes]]\nname = "a"\nkind = "pressure"\npoint = [0.5, 1.2, 0]\n',
        "probes.0.point: (0.5, 1.2, 0) m is outside the box of (1, 1, 1) m",
    ),
    "gauge outside the box": (
        '[[probes]]\nname = "a"\nkind = "height"\nat = [0.5, -0.1]\n',
        "probes.0.at: (0.5, -0.1) m is outside the box of (1, 1, 1) m",
    ),
    "probes of one name": (
        '[[probes]]\nname = "a"\nkind = "front"\naxis = "+x"\n'
        '[[probes]]\nname = "a"\nkind = "front"\naxis = "-x"\n',
        "probes.1.name: there are two probes named 'a'",
    ),
    "probe name that breaks tables": (
        '[[probes]]\nname = "a, b"\nkind = "front"\naxis = "+x"\n',
        "probes.0.name: string should match pattern",
    ),
    "unknown axis": (
        '[[probes]]\nname = "a"\nkind = "front"\naxis = "up"\n',
        "probes.0.axis: input should be '+x', '-x', '+y', '-y', '+z' or '-z' (got 'up')",
    ),
    "unknown view": ('[picture]\nview = "sped"\n', "picture.view: unknown view 'sped'"),
}

BAD_OVERRIDES = {
    "box.size=[1, 0, 1]": "box.size.1: input should be greater than or equal to 0.001 (got 0)",
    "box.size=[1, 1]": "box.size",
    "layers=[]": "layers: ",
    "water=[]": "water: ",
    "layers.0.mass=0": "layers.0.mass: input should be greater than 0.000000000001 (got 0)",
    "layers.0.spacing=0.1": "layers.0: give either mass or spacing",
    "layers.0.mass=2000": "layers.0: particles of 1.26 m do not fit in the box",
    "layers.9.mass=1": "layers.9.mass: expected an index from 0 to 1, got '9'",
    "water.0.hi=[1, 0, 1]": "water.0.hi: has no volume",
    "water.0.hi=[1, 1.5, 1]": "water.0: reaches from (0, 0, 0) m to (1, 1.5, 1) m, outside the box",
    "water.0.layer=2": "water.0.layer: must be a layer's index from 0 to 1 (got 2)",
    "water.0.radius=0.1": "water.0: give either lo and hi, or centre and radius",
    "water.0.count=99999": "water.0.count: 99999 particles do not fit, there is room for",
    "layers.0.mass=1e-9": "water: 500,000,000,000 particles in a box of (1, 1, 1) m need",
    "box.size=[9999, 9999, 9999]": "GiB, most of it for surface",
    "layers.0.smoothing=1.5": "layers.0.smoothing: must be at least 1.7 for the method projection",
    "projection.spray=1": "projection.spray: input should be less than or equal to 0.95",
    "surface.cell=2": "surface.cell: is too coarse for surface.smoothing = 1.6; at most 1.96",
    "layers.0.spacing=1e-200": "layers.0.spacing: input should be greater than 0.00001",
    "density=1e30": "density: input should be less than or equal to 100000",
    "duration": "--set: duration: expects key=value",
    "variant=four": "--set: variant: unknown variant 'four'; known: none in this scene",
    "title.text=1": "title: input should be a valid string (got {'text': 1})",
    "water.0.lo.0.a=1": "--set: water.0.lo.0.a: 'a' is not a parameter",
}


def write(tmp_path, text, name="scene.toml"):
    path = tmp_path / name
    path.write_text(text)
    return str(path)


@pytest.mark.parametrize("name", BAD)
def test_bad_scene_gives_one_line_with_file_and_key(tmp_path, name):
    text, message = BAD[name]
    with pytest.raises(SceneError) as error:
        load_scene(write(tmp_path, text + GOOD))
    line = str(error.value)
    assert line.startswith(f"scene.toml: {message}") and "\n" not in line


def test_byte_order_mark_is_accepted(tmp_path):
    path = tmp_path / "scene.toml"
    path.write_text(GOOD, encoding="utf-8-sig")
    assert load_scene(str(path)) == load_scene(write(tmp_path, GOOD, "plain.toml"))


def test_probe_inside_a_body_gives_a_caution(tmp_path):
    body = "[[bodies]]\ncentre = [0.5, 0.2, 0.5]\nradius = 0.3\n"
    probe = '[[probes]]\nname = "{}"\nkind = "pressure"\npoint = [0.5, {}, 0.5]\n'
    text = GOOD + body + probe.format("in", 0.3) + probe.format("on", 0.5)
    (line,) = cautions(load_scene(write(tmp_path, text)))
    assert line.startswith("probes.0: (0.5, 0.3, 0.5) m is inside a body")


def test_floating_bodies_that_overlap_at_the_start_give_a_caution(tmp_path):
    box = "[[bodies]]\nlo = [{0}, 0.4, 0.4]\nhi = [{1}, 0.6, 0.6]\n"
    ball = "[[bodies]]\ncentre = [0.75, 0.5, 0.5]\nradius = 0.1\ndensity = 500\n"
    text = GOOD + box.format(0.2, 0.4) + box.format(0.35, 0.5) + box.format(0.5, 0.7)
    assert not cautions(load_scene(write(tmp_path, text)))
    (line,) = cautions(load_scene(write(tmp_path, text + ball)))
    assert line.startswith("bodies.3: overlaps bodies.2 at the start")


def test_layer_too_coarse_for_its_box_gives_a_caution(tmp_path):
    scene = load_scene(write(tmp_path, GOOD), ("layers.1.spacing=0.35",))
    line, _ = cautions(scene)
    assert line.startswith("layers.1: pressures will be inaccurate") and "0.35 m" in line
    assert not cautions(load_scene(write(tmp_path, GOOD)))


def test_layers_of_very_different_masses_give_a_caution(tmp_path):
    """Layers count as next to each other by mass, in whichever order they are listed."""
    ratios = {"0.1": [], "0.12": ["layers.1"]}  # edges of the coarser particles of layer 1
    for spacing, named in ratios.items():
        scene = load_scene(write(tmp_path, GOOD), (f"layers.1.spacing={spacing}",))
        assert [line.split(":")[0] for line in cautions(scene)] == named


@pytest.mark.parametrize("override", BAD_OVERRIDES)
def test_bad_override_gives_one_line_with_its_key(tmp_path, override):
    with pytest.raises(SceneError) as error:
        load_scene(write(tmp_path, GOOD), (override,))
    line = str(error.value)
    assert BAD_OVERRIDES[override] in line and "\n" not in line


def test_overlapping_water_is_refused(tmp_path):
    more = "[[water]]\ncentre = [0.5, 0.5, 0.5]\nradius = 0.1\n"
    with pytest.raises(SceneError, match=r"water\.1: overlaps water\.0"):
        load_scene(write(tmp_path, GOOD + more))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "is empty"),
        (b"\x89PNG\r\n\xff\xfe", "is not a text file"),
        (b"box = [", "is not TOML"),
        (b"\n[box]\nsize = [1, 1, 1]\n", "layers: is required (and 1 more)"),
    ],
)
def test_broken_file_gives_one_line(tmp_path, content, message):
    path = tmp_path / "broken.toml"
    path.write_bytes(content)
    with pytest.raises(SceneError) as error:
        load_scene(str(path))
    assert str(error.value).startswith("broken.toml: ") and message in str(error.value)


def test_missing_scene_suggests_the_nearest_name(tmp_path):
    with pytest.raises(SceneError, match="did you mean 'dam_break'"):
        load_scene("dam_brake")
    with pytest.raises(SceneError, match="is a folder"):
        load_scene(str(tmp_path))


@pytest.mark.parametrize("name", shipped_scenes())
def test_shipped_scenes_have_titles_sources_no_caution_and_the_specified_mass(name):
    """The mass of the particles is exact to half a particle per part of the water."""
    scene = load_scene(name)
    assert scene.title and scene.source and effort(scene) == []
    specs = layer_specs(scene)
    laid = sum(specs[k].mass for k in initial_particles(scene, specs)["layer"])
    half_particles = 0.5 * sum(specs[w.layer].mass for w in scene.water)
    assert abs(laid - specified_mass(scene, specs)) <= half_particles + 1e-9


@pytest.mark.parametrize("name", ["pool", "pool_2x"])
@pytest.mark.parametrize(
    ("system", "counts"),
    [
        (1, {"pool": [2650], "pool_2x": [5100]}),
        (2, {"pool": [4650], "pool_2x": [9200]}),
        (3, {"pool": [800, 400, 250, 350], "pool_2x": [800, 400, 250, 1050]}),
    ],
)
def test_thesis_pools_have_the_particles_of_table_5_1(name, system, counts):
    scene = load_scene(name, (f"variant=system-{system}",))
    layers = initial_particles(scene, layer_specs(scene))["layer"]
    assert [int((layers == k).sum()) for k in range(len(scene.layers))] == counts[name]
    assert not scene.adaptation.enabled


@pytest.mark.parametrize("name", ["pool", "pool_2x"])
def test_pools_have_the_layers_and_mass_of_system_3_and_adapt(name):
    scene, system_3 = load_scene(name), load_scene(name, ("variant=system-3",))
    assert scene.adaptation.enabled and scene.layers == system_3.layers
    assert specified_mass(scene, layer_specs(scene)) == pytest.approx(
        specified_mass(system_3, layer_specs(system_3))
    )


@pytest.mark.parametrize("name", ["pool", "pool_2x"])
def test_classic_method_refuses_adaptation(name):
    assert load_scene(name, ("variant=system-3", "method=classic")).method == "classic"
    with pytest.raises(SceneError, match="the method classic cannot adapt layers"):
        load_scene(name, ("method=classic",))


def test_dam_is_twice_as_high_as_wide():
    (column,) = load_scene("dam_break").water
    assert (column.hi[1] - column.lo[1]) == 2.0 * (column.hi[0] - column.lo[0])


def test_effective_scene_loads_to_the_same_scene(tmp_path):
    changes = ("duration=3", "layers.0.gravity_factor=0.5", "method=classic")
    scene = load_scene("pool", ("variant=system-3", *changes))
    assert scene.layers[0].gravity_factor == 0.5
    assert load_scene(write(tmp_path, to_toml(scene, "quality large"))) == scene


def test_override_of_text_needs_no_quotes(tmp_path):
    assert load_scene(write(tmp_path, GOOD), ("picture.view=speed",)).picture.view == "speed"


def test_every_parameter_is_declared_with_unit_and_help():
    listed = parameters(Scene)
    assert len({p.key for p in listed}) == len(listed) > 40
    assert all(p.text and p.unit for p in listed)
    by_key = {p.key: p for p in listed}
    assert by_key["box.size"].unit == "m" and by_key["box.size"].default == "required"
    assert by_key["classic.pressure_form"].kind == "mean | squared | product"
    assert by_key["box.restitution"].limits == ">= 0.0, <= 1.0"


@pytest.mark.parametrize("method", ["classic", "projection"])
def test_scenes_have_the_main_views_and_at_most_seven(method):
    names = views(load_scene("pool", ("variant=system-3", f"method={method}")))
    assert len(set(names)) == len(names)
    assert {"water", "layers", "speed", "density_error", "pressure", "particles"} <= set(names)
    assert len(names) <= 7


def test_an_override_may_have_several_lines(tmp_path):
    scene = load_scene(write(tmp_path, GOOD), ("box.size=[\n\t2.0,\n\t2.0,\n\t1.0\n]",))
    assert scene.box.size == (2.0, 2.0, 1.0)


@pytest.mark.parametrize(
    ("text", "value"),
    [(".9", 0.9), ("[-.1, 1]", [-0.1, 1]), ("[1., +.5e-3]", [1.0, 5e-4]), ("x.9.obj", "x.9.obj")],
)
def test_numbers_need_no_digit_on_both_sides_of_the_point(text, value):
    """Overrides accept numbers without the digits that TOML requires on both sides of the point.

    Regression: such a number was read as a string.
    """
    assert parse_override(f"a.b={text}") == ("a.b", value)


def test_incomplete_list_in_an_override_is_refused():
    with pytest.raises(SceneError, match=r"--set: gravity: is not a TOML value: '\[0, -9.81'"):
        parse_override("gravity=[0, -9.81")


def test_unknown_table_is_refused_with_a_reference_to_the_documentation(tmp_path):
    text = shipped_scenes()["still"].read_text() + "\n[[magnetism]]\nrate = 1.0\n"
    (tmp_path / "mill.toml").write_text(text)
    with pytest.raises(SceneError, match=r"magnetism: no such table; docs/scenes.md says what is"):
        load_scene(str(tmp_path / "mill.toml"))
