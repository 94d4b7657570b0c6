"""Tests of initial particles: mass, volume and shape of the water that a scene specifies."""

import itertools

import numpy as np
import pytest

from msph.scene import SceneError
from msph.scene.water import capacity, fill, initial_particles, layer_specs, specified_mass
from tests.scenes_kit import CUBE, load

TEXT = CUBE.replace("mass = 0.3", "mass = 0.2")


def sites(scene, layer=0):
    """Returns the particles [m] of the first part of the water, without jitter, and their layer."""
    spec = layer_specs(scene)[layer]
    water = scene.water[0].model_copy(update={"jitter": 0.0})
    return fill(water, spec, np.random.default_rng(0)), spec


def asked(scene):
    return specified_mass(scene, layer_specs(scene))


def laid_mass(scene):
    specs = layer_specs(scene)
    return sum(specs[k].mass for k in initial_particles(scene, layer_specs(scene))["layer"])


# Width, depth and spacing [m]. Regression: a block 0.6 m wide and 0.4 m deep had 4.2 % too little
# mass at a spacing of 0.048 m, and 5 % too much at 0.06 m.
BLOCKS = itertools.product([0.6], [0.4, 0.333, 0.05], [0.031, 0.048, 0.06, 0.0876])


@pytest.mark.parametrize(
    ("width", "depth", "spacing"), [*BLOCKS, (0.21, 0.97, 0.09), (0.3, 0.97, 0.09)]
)
def test_mass_of_a_block_is_exact_to_half_a_particle(tmp_path, width, depth, spacing):
    scene = load(
        *(tmp_path, TEXT, f"water.0.hi=[{width}, {depth}, {width}]", f"layers.1.spacing={spacing}"),
        "water.0.layer=1",
    )
    assert asked(scene) == pytest.approx(1000.0 * width**2 * depth)
    assert abs(laid_mass(scene) - asked(scene)) <= 0.5 * layer_specs(scene)[1].mass + 1e-9
    assert len(initial_particles(scene, layer_specs(scene))["x"]) == capacity(
        scene, layer_specs(scene)
    )


@pytest.mark.parametrize("spacing", [0.031, 0.0437, 0.05])
@pytest.mark.parametrize("adaptive", ["true", "false"])
def test_mass_of_layered_water_is_exact_to_half_a_particle_per_part(tmp_path, spacing, adaptive):
    text = f"""
[box]
size = [0.6, 0.6, 0.6]
[adaptation]
enabled = {adaptive}
[[layers]]
spacing = {spacing}
[[layers]]
spacing = {spacing * 2 ** (1 / 3):.6f}
[[water]]
layer = 1
lo = [0, 0, 0]
hi = [0.6, 0.23, 0.6]
[[water]]
lo = [0, 0.23, 0]
hi = [0.6, 0.31, 0.6]
[[water]]
centre = [0.3, 0.45, 0.3]
radius = 0.1
"""
    scene = load(tmp_path, text)
    specs = layer_specs(scene)
    assert asked(scene) == pytest.approx(111.6 + 4.18879)
    half_particles = 0.5 * sum(specs[w.layer].mass for w in scene.water)
    assert abs(laid_mass(scene) - asked(scene)) <= half_particles
    if adaptive == "true":
        assert specs[1].mass == 2.0 * specs[0].mass


def test_water_given_by_count_has_the_mass_of_its_particles(tmp_path):
    scene = load(tmp_path, TEXT, "water.0.count=1445")
    assert asked(scene) == pytest.approx(289.0) == laid_mass(scene)


def test_count_of_particles_that_do_not_fit_is_refused(tmp_path):
    assert len(sites(load(tmp_path, TEXT, "water.0.count=2500"))[0]) == 2500
    with pytest.raises(SceneError, match="2501 particles do not fit, there is room for 2500"):
        load(tmp_path, TEXT, "water.0.count=2501")


@pytest.mark.parametrize("count", [None, 1445, 2000])
def test_filled_water_has_its_volume_and_is_uniform_in_height(tmp_path, count):
    x, spec = sites(load(tmp_path, TEXT, *([f"water.0.count={count}"] if count else [])))
    height = len(x) * spec.volume
    # The mean height is exact to 0.02 spacings, and the height of the surface to 0.1 spacings.
    assert x[:, 1].mean() == pytest.approx(0.5 * height, abs=0.02 * spec.spacing)
    assert x[:, 1].max() == pytest.approx(height - 0.5 * spec.spacing, abs=0.1 * spec.spacing)
    assert x.min() > 0.0 and x[:, [0, 2]].max() < 1.0


@pytest.mark.parametrize("spacing", [0.048, 0.06, 0.087])
def test_horizontal_planes_of_a_block_have_nearly_equal_particle_numbers(tmp_path, spacing):
    scene = load(
        *(tmp_path, TEXT, "water.0.hi=[0.6, 0.4, 0.6]", f"layers.1.spacing={spacing}"),
        "water.0.layer=1",
    )
    x, _ = sites(scene, 1)
    _, held = np.unique(x[:, 1].round(6), return_counts=True)
    assert held.max() <= 1.04 * held.min()


def test_lattice_a_few_spacings_wide_is_nearly_cubic(tmp_path):
    """Regression: with 3 x 3 columns, cells were half as wide again as high. The gaps counted as
    air, and all the water was split."""
    scene = load(tmp_path, TEXT, "layers.1.spacing=0.294")
    water = scene.water[0].model_copy(update={"jitter": 0.0, "lo": (0, 0, 0), "hi": (1, 2, 1)})
    x = fill(water, layer_specs(scene)[1], np.random.default_rng(0))
    columns = [x[(x[:, [0, 2]] == c).all(axis=1), 1] for c in np.unique(x[:, [0, 2]], axis=0)]
    edges = [np.diff(np.unique(x[:, k].round(6))).min() for k in (0, 2)]
    edges += [np.diff(column).max() for column in columns]
    assert max(edges) < 1.35 * min(edges)


def test_ball_has_the_mass_of_its_volume(tmp_path):
    text = TEXT + "[[water]]\ncentre = [0.5, 0.8, 0.5]\nradius = 0.18\n"
    scene = load(tmp_path, text)
    x, spec = initial_particles(scene, layer_specs(scene))["x"], layer_specs(scene)[0]
    ball = x[x[:, 1] > 0.55]
    assert abs(len(ball) * spec.volume - 4.18879 * 0.18**3) <= 0.5 * spec.volume
    assert abs(ball - [0.5, 0.8, 0.5]).max() < 0.25
