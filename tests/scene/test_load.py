"""Tests of loading scenes: defaults, overrides, cautions and shipped scenes."""

import pytest

from msph.scene import SceneError, load_scene
from msph.scene.check import cautions, views
from msph.scene.effort import effort
from msph.scene.library import shipped_scenes
from msph.scene.load import parse_override, to_toml
from msph.scene.parameters import parameters
from msph.scene.schema import Scene
from msph.scene.water import initial_particles, layer_specs, specified_mass
from tests.scenes_kit import CUBE, load, write


def test_byte_order_mark_is_accepted(tmp_path):
    path = tmp_path / "scene.toml"
    path.write_text(CUBE, encoding="utf-8-sig")
    assert load_scene(str(path)) == load_scene(write(tmp_path, CUBE, "plain.toml"))


def test_probe_inside_a_body_gives_a_caution(tmp_path):
    body = "[[bodies]]\ncentre = [0.5, 0.2, 0.5]\nradius = 0.3\n"
    probe = '[[probes]]\nname = "{}"\nkind = "pressure"\npoint = [0.5, {}, 0.5]\n'
    text = CUBE + body + probe.format("in", 0.3) + probe.format("on", 0.5)
    (line,) = cautions(load(tmp_path, text))
    assert line.startswith("probes.0: (0.5, 0.3, 0.5) m is inside a body")


def test_floating_bodies_that_overlap_at_the_start_give_a_caution(tmp_path):
    box = "[[bodies]]\nlo = [{0}, 0.4, 0.4]\nhi = [{1}, 0.6, 0.6]\n"
    ball = "[[bodies]]\ncentre = [0.75, 0.5, 0.5]\nradius = 0.1\ndensity = 500\n"
    text = CUBE + box.format(0.2, 0.4) + box.format(0.35, 0.5) + box.format(0.5, 0.7)
    assert not cautions(load(tmp_path, text))
    (line,) = cautions(load(tmp_path, text + ball))
    assert line.startswith("bodies.3: overlaps bodies.2 at the start")


def test_layer_too_coarse_for_its_box_gives_a_caution(tmp_path):
    scene = load(tmp_path, CUBE, "layers.1.spacing=0.35")
    line, _ = cautions(scene)
    assert line.startswith("layers.1: pressures will be inaccurate") and "0.35 m" in line
    assert not cautions(load(tmp_path, CUBE))


def test_layers_of_very_different_masses_give_a_caution(tmp_path):
    """Layers count as next to each other by mass, in whichever order they are listed."""
    ratios = {"0.1": [], "0.12": ["layers.1"]}  # edges of the coarser particles of layer 1
    for spacing, named in ratios.items():
        scene = load(tmp_path, CUBE, f"layers.1.spacing={spacing}")
        assert [line.split(":")[0] for line in cautions(scene)] == named


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


@pytest.mark.parametrize(
    ("text", "value"),
    [
        *((".9", 0.9), ("[-.1, 1]", [-0.1, 1]), ("[1., +.5e-3]", [1.0, 5e-4])),
        *(("x.9.obj", "x.9.obj"), ("speed", "speed"), ("[\n\t2.0,\n\t1.0\n]", [2.0, 1.0])),
    ],
)
def test_overrides_need_no_quotes_and_no_digit_on_both_sides_of_the_point(text, value):
    """Regression: numbers without the digits that TOML requires were read as strings."""
    assert parse_override(f"a.b={text}") == ("a.b", value)
