"""Tests of probes against known fields and shapes: linear pressures, flat and tilted water."""

import numpy as np
import pytest

from msph.measure.probes import (
    FluxProbe,
    ForceProbe,
    FrontProbe,
    HeightProbe,
    PressureProbe,
    VelocityProbe,
)
from msph.measure.snapshot import Snapshot
from msph.scene.bodies import bodies
from msph.scene.schema import Scene
from msph.scene.water import layer_specs
from tests.boundary_kit import boundary_of
from tests.fluid.fluid_kit import block_of

SIZE = (0.8, 0.8, 0.8)
D = 0.04
LEVEL = 0.4
RHO_G_D = 9810 * D


def filled(jitter=0.0, keep=lambda x: x[:, 1] < LEVEL, d=D):
    x = block_of(SIZE, d)
    x = x[keep(x)]
    return x + np.random.default_rng(4).uniform(-0.5, 0.5, x.shape) * jitter * d


def snapshot(x, d=D, smoothing=2.0, pressure=None, free=lambda points, margin: True, **more):
    sizes = np.full(len(x), d), np.full(len(x), smoothing * d)
    return Snapshot(x, pressure, *sizes, SIZE, free, **more)


PILLAR = np.array([(0.2, -1.0, 0.2), (0.44, 0.6, 0.44)])


def beside_pillar(points, margin):
    """Returns, like Boundary.free(), which points [m] are at least `margin` [m] outside a pillar
    that stands on the floor and rises above the water."""
    q = np.maximum(PILLAR[0] - points, points - PILLAR[1])
    outside = np.linalg.norm(np.maximum(q, 0.0), axis=1) + np.minimum(q.max(axis=1), 0.0)
    return outside >= margin


def round_pillar():
    x = filled(jitter=0.2, keep=lambda x: (x[:, 1] < LEVEL) & beside_pillar(x, 0.0))
    return snapshot(x, pressure=field(x), free=beside_pillar, bodies=True)


@pytest.mark.parametrize(
    "point",
    [(0.44, 0.2, 0.3), (0.44, 0.0, 0.3), (0.3, 0.35, 0.2), (0.44, 0.2, 0.44), (0.44, 0.0, 0.44)],
    ids=("face", "foot", "face near the surface", "edge", "foot of an edge"),
)
def test_pressure_and_height_are_read_on_a_body(point):
    water = round_pillar()
    expected = field(np.array(point))
    assert PressureProbe("p", point).read(water)[0] == pytest.approx(
        expected, abs=0.03 * RHO_G_D * 10
    )
    assert HeightProbe("h", (point[0], point[2])).read(water)[0] == pytest.approx(
        LEVEL, abs=0.2 * D
    )


def test_probes_in_air_next_to_a_body_and_inside_it_read_nothing():
    water = round_pillar()
    for point in ((0.44, 0.5, 0.3), (0.3, 0.2, 0.3), (0.42, 0.2, 0.3)):
        assert np.isnan(PressureProbe("p", point).read(water)).all()
    assert np.isnan(HeightProbe("h", (0.3, 0.3)).read(water)).all()


def test_pressure_is_read_at_all_points_of_a_body_in_water():
    """Half of the kernel lies in the body, and the coverage there is by chance below one half."""
    rng = np.random.default_rng(6)
    points = np.column_stack(
        [np.full(40, 0.44), rng.uniform(0.05, 0.3, 40), rng.uniform(0.2, 0.44, 40)]
    )
    water = round_pillar()
    assert water.pressures(points).min() > 0.0


def field(x):
    """Returns the pressure [Pa] of water at rest in a pool that accelerates along x and z."""
    return 9810 * (LEVEL - x[..., 1]) + 900 * x[..., 0] - 400 * x[..., 2]


PLACES = {
    "inside": (0.41, 0.2, 0.4),
    "floor": (0.43, 0.0, 0.4),
    "side": (0.0, 0.21, 0.4),
    "far side": (0.8, 0.1, 0.33),
    "edge": (0.0, 0.0, 0.4),
    "corner": (0.0, 0.0, 0.8),
    "near the surface": (0.4, 0.37, 0.4),
}


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize(("jitter", "smoothing"), [(0.0, 2.0), (0.4, 2.0), (0.4, 2.4)])
def test_linear_pressure_is_read_exactly_also_on_walls(place, jitter, smoothing):
    x = filled(jitter)
    water = snapshot(x, smoothing=smoothing, pressure=field(x))
    (read,) = PressureProbe("p", PLACES[place]).read(water)
    # A mean over the neighbours would be off by half a spacing at a wall: 0.5 rho g d.
    assert read == pytest.approx(field(np.array(PLACES[place])), abs=0.01 * RHO_G_D)


def test_pressure_is_unknown_in_air_and_before_the_first_step():
    x = filled()
    in_air = PressureProbe("p", (0.4, 0.6, 0.4))
    assert np.isnan(in_air.read(snapshot(x, pressure=field(x)))).all()
    assert np.isnan(PressureProbe("p", (0.4, 0.2, 0.4)).read(snapshot(x))).all()


def test_pressure_under_a_sheet_one_particle_thick_is_not_extrapolated():
    """The pressure gradient across the sheet is unknown."""
    x = filled(0.02, keep=lambda x: x[:, 1] < D)
    p = 0.5 * RHO_G_D * (1 + 0.1 * np.random.default_rng(1).normal(size=len(x)))
    (read,) = PressureProbe("p", (0.4, 0.0, 0.4)).read(snapshot(x, pressure=p))
    assert read == pytest.approx(0.5 * RHO_G_D, rel=0.5)


@pytest.mark.parametrize("at", [(0.4, 0.4), (0.413, 0.371), (0.0, 0.4), (0.0, 0.8)])
@pytest.mark.parametrize(("smoothing", "jitter"), [(2.0, 0.0), (2.4, 0.2)])
def test_height_of_flat_water(at, smoothing, jitter):
    (read,) = HeightProbe("h", at).read(snapshot(filled(jitter), smoothing=smoothing))
    assert read == pytest.approx(LEVEL, abs=(0.02 + jitter) * D)


@pytest.mark.parametrize("x", [0.2, 0.4, 0.6])
def test_height_of_tilted_water(x):
    slope, d = 0.3, 0.02
    wet = filled(d=d, keep=lambda p: p[:, 1] < 0.3 + slope * (p[:, 0] - 0.4))
    (read,) = HeightProbe("h", (x, 0.4)).read(snapshot(wet, d))
    assert read == pytest.approx(0.3 + slope * (x - 0.4), abs=0.5 * d)


def test_height_ignores_a_lone_drop_and_is_unknown_over_a_dry_floor():
    x = filled(keep=lambda x: (x[:, 1] < LEVEL) & (x[:, 0] < 0.4))
    water = snapshot(np.concatenate([x, [[0.2, 0.7, 0.4]]]))
    assert HeightProbe("h", (0.2, 0.4)).read(water)[0] == pytest.approx(LEVEL, abs=0.05 * D)
    assert np.isnan(HeightProbe("h", (0.6, 0.4)).read(water)).all()


def test_height_in_a_full_box_is_the_height_of_the_lid():
    assert HeightProbe("h", (0.4, 0.4)).read(snapshot(filled(keep=lambda x: x[:, 1] > 0)))[0] == 0.8


def tongue():
    """Returns water with a tongue one particle thick ahead of it, along x."""
    return filled(
        keep=lambda x: (x[:, 0] < 0.3) & (x[:, 1] < 0.3) | (x[:, 0] < 0.5) & (x[:, 1] < D)
    )


def test_front_is_the_end_of_the_connected_bulk():
    """The tongue belongs to the front, spray ahead of the tongue does not."""
    spray = np.array([[0.66, 0.02, 0.4], [0.7, 0.1, 0.3], [0.2, 0.6, 0.2]])
    water = snapshot(np.concatenate([tongue(), spray]))
    # The last column of the tongue has its centre at 0.5 m - d/2.
    assert FrontProbe("f", "+x").read(water)[0] == pytest.approx(0.48)
    assert FrontProbe("f", "+y").read(water)[0] == pytest.approx(0.28)
    assert FrontProbe("f", "-x").read(water)[0] == 0.0
    assert FrontProbe("f", "+z").read(water)[0] == pytest.approx(0.8)


def test_a_front_does_not_move_back():
    """A tongue breaks off, so that the bulk ends farther back; resume() keeps the front."""
    whole = tongue()
    broken = whole[(whole[:, 0] < 0.36) | (whole[:, 0] > 0.44)]
    front, resumed = FrontProbe("f", "+x"), FrontProbe("f", "+x")
    reached = front.read(snapshot(whole))
    assert FrontProbe("f", "+x").read(snapshot(broken))[0] < reached[0] - 2 * D
    assert front.read(snapshot(broken)) == reached
    resumed.resume(reached)
    assert resumed.read(snapshot(broken)) == reached


@pytest.mark.parametrize("point", [(0.41, 0.2, 0.4), (0.0, 0.2, 0.4), (0.8, 0.0, 0.0)])
def test_linear_velocity_is_read_exactly_and_none_in_air(point):
    x = filled(0.4)
    gradient, mean = np.array([[0.0, 0.5, 0.1], [1.0, 0.0, -0.2], [0.3, 0.2, 0.0]]), (1.0, 0.0, 2.0)
    v = x @ gradient + mean
    water = snapshot(x, v=v)
    read = VelocityProbe("v", point).read(water)
    assert read == pytest.approx((np.array(point) @ gradient + mean).tolist(), abs=0.02)
    assert np.isnan(VelocityProbe("v", (0.4, 0.7, 0.4)).read(water)).all()


@pytest.mark.parametrize("top", [0.2, 0.8])
def test_flux_through_a_rectangle_under_water_and_through_the_surface(top):
    """In water 0.4 m deep with the speed 2 + y, the flux is the integral of 2 + y over width and
    depth."""
    x = filled(0.2)
    v = np.stack([2.0 + x[:, 1], 5.0 + 0.0 * x[:, 1], 0.0 * x[:, 1]], axis=1)
    read = FluxProbe("q", (0.4, 0.0, 0.2), (0.4, top, 0.6)).read(snapshot(x, v=v))
    depth = min(top, LEVEL)
    assert read == pytest.approx([0.4 * (2.0 * depth + 0.5 * depth**2)], rel=0.02)
    dry = FluxProbe("q", (0.2, 0.6, 0.2), (0.6, 0.6, 0.6)).read(snapshot(x, v=v))
    assert np.isnan(dry).all()


def test_pressure_is_averaged_over_the_face_and_the_window():
    """The dry half of a face counts as zero."""
    x = filled(0.2)
    on_floor = PressureProbe("p", (0.2, 0.0, 0.2), (0.6, 0.0, 0.4))
    expected = field(np.array([0.4, 0.0, 0.3]))
    assert on_floor.read(snapshot(x, pressure=field(x))) == pytest.approx([expected], rel=0.01)
    still = 9810.0 * (LEVEL - x[:, 1])
    wall = PressureProbe("p", (0.0, 0.2, 0.2), (0.0, 0.6, 0.6))
    mean = 0.5 * 0.5 * 9810.0 * 0.2
    assert wall.read(snapshot(x, pressure=still)) == pytest.approx([mean], rel=0.1)
    sampled = PressureProbe("p", (0.4, 0.0, 0.4), window=0.03)
    times = (0.0, 0.01, 0.02, 0.03)
    read = [sampled.read(snapshot(x, pressure=still * (1 + t), time=t))[0] for t in times]
    assert read[3] / read[0] == pytest.approx(1.02, rel=1e-3)


def test_dry_readings_count_as_zero_in_means():
    """A mean over the window begins with its dry readings, not with the first wet one: otherwise an
    impact would have its peak for a mean."""
    x = filled(0.2)
    still = 9810.0 * (LEVEL - x[:, 1])
    dry_face = PressureProbe("p", (0.0, 0.6, 0.2), (0.0, 0.7, 0.6))
    assert dry_face.read(snapshot(x, pressure=still)) == [0.0]
    sampled = PressureProbe("p", (0.4, 0.0, 0.4), window=0.03)
    low = x[:, 1] > 0.25  # no water at the sensor
    first = snapshot(x[low], pressure=still[low], time=0.0)
    assert sampled.read(first) == [0.0]
    wet = sampled.read(snapshot(x, pressure=still, time=0.01))[0]
    assert wet == pytest.approx(0.5 * 9810.0 * LEVEL, rel=0.05)


BALL = (0.42, 0.2, 0.38)


def sunk(body, tilt=0.0):
    """Returns the probe of a body and a snapshot of the water around it under the pressure
    p = rho g (H - y) + tilt (0.4 - x) (1 - y/H), which is zero at the surface."""
    water = [{"lo": [0, 0, 0], "hi": [SIZE[0], LEVEL, SIZE[2]]}]
    box, layers = {"size": SIZE}, [{"spacing": D}]
    scene = Scene.model_validate({"box": box, "layers": layers, "water": water, "bodies": [body]})
    (body,) = bodies(scene)
    boundary = boundary_of(SIZE, layer_specs(scene), [body])
    x = filled(0.2)
    x = x[boundary.free(x)]
    pressure = (9810.0 * LEVEL + tilt * (0.4 - x[:, 0])) * (1.0 - x[:, 1] / LEVEL)
    more = {"bodies": True, "poses": (boundary.pose(0),)}
    water = snapshot(x, pressure=pressure, free=boundary.free, **more)
    return ForceProbe.of("f", scene, "bodies.0"), water


def test_force_on_a_submerged_ball_is_the_weight_of_the_displaced_water():
    probe, water = sunk({"centre": BALL, "radius": 0.12})
    volume = 4.0 / 3.0 * np.pi * 0.12**3
    read = np.array(probe.read(water))
    expected = [0.0, 9810.0 * volume, 0.0]
    assert read[:3] == pytest.approx(expected, abs=0.02 * 9810.0 * volume)
    assert np.abs(read[3:]).max() < 0.01 * 9810.0 * volume * 0.12


def test_force_and_torque_on_a_pillar_in_a_pressure_gradient():
    """The pressure falls across the pillar by tilt w (1 - y/H), which gives the force tilt w^2 H/2
    at the height H/3. The pillar's foot is dry, and its centre is 0.3 m high."""
    probe, water = sunk({"lo": [0.28, 0, 0.28], "hi": [0.52, 0.6, 0.52]}, tilt=2000.0)
    read, force = np.array(probe.read(water)), 2000.0 * 0.24**2 * 0.5 * LEVEL
    assert read[0] == pytest.approx(force, rel=0.05)
    assert read[1] == pytest.approx(0.0, abs=0.02 * force) and abs(read[2]) < 0.02 * force
    assert read[5] == pytest.approx(force * (0.3 - LEVEL / 3.0), rel=0.05)
