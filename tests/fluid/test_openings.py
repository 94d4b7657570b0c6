"""Inflows and outflows: conservation, continuous pressure, holes, jets, a full pool."""

import math

import numpy as np
import pytest
import taichi as ti

from msph.expressions import ExpressionError
from msph.fluid.boundary.opening import ZONE, Opening, Valve
from msph.fluid.boundary.rigid_bodies import Ball
from msph.fluid.constants import MAX_OPENINGS
from msph.fluid.external_forces import ExternalForces
from msph.fluid.simulation import Simulation
from msph.launches import data_oriented, kernel, watch_compiling
from msph.measure.ledger import Ledger
from msph.measure.summary import water_mass
from msph.scene import load_scene
from msph.scene.build import build_simulation
from msph.scene.errors import SceneError
from msph.scene.openings import openings
from msph.scene.water import layer_specs
from tests.fluid.fluid_kit import (
    GRAVITY,
    SPLASH,
    block_of,
    imbalance,
    parts,
    place,
    record,
    spec_of,
)
from tests.fluid.fluid_kit import simulate as water

D = 0.04
SIZE = (0.4, 0.4, 0.4)
UP, DOWN = np.array([0.0, 1.0, 0.0]), np.array([0.0, -1.0, 0.0])
FLOOR = np.array([0.2, 0.0, 0.2])


def disc(centre, direction, enters: bool, speed: float | None, radius: float = 0.07) -> Opening:
    rate = None if speed is None else Valve(speed)
    return Opening(np.array(centre, float), np.array(direction), (radius, radius), enters, rate)


def simulate(*openings: Opening, height=0.2, capacity=4000, **options) -> Simulation:
    x = block_of((0.4, height, 0.4), D)
    return water(SIZE, [spec_of(D)], x, openings=openings, capacity=capacity, **options)


@pytest.fixture
def through_flow():
    """Returns water that enters through the floor and leaves through a hole in the floor."""
    return simulate(disc(FLOOR, UP, True, 0.6), disc((0.07, 0.0, 0.07), DOWN, False, None, 0.06))


def test_mass_and_momentum_that_enter_and_leave_are_recorded(through_flow):
    sim = through_flow
    ledger = record(sim, 0.3)
    flowed = steps = 0
    for _ in range(60):
        before, done = ledger.entries[-1], sim.steps
        sim.advance(1e-3, ExternalForces())
        after = ledger.record(GRAVITY)
        masses = [e.mass + e.outflow_mass - e.inflow_mass for e in (before, after)]
        assert masses[1] == pytest.approx(masses[0], rel=1e-6)
        assert after.outside == 0
        if sim.steps - done > 1:
            continue
        assert np.linalg.norm(imbalance(before, after, 1e-3)) < 1e-5 * before.mass * 9.81e-3
        flowed += after.outflow_mass > before.outflow_mass
        steps += 1
    assert flowed > 3 and steps > 40
    assert ledger.entries[-1].spilt == 0.0


@data_oriented
class Hidden:
    """Kernel that finds which mirror images of pairs of points openings hide."""

    def __init__(self, apertures):
        self.apertures = apertures

    @kernel
    def find(
        self,
        pairs: ti.types.ndarray(dtype=ti.f32, ndim=2),
        found: ti.types.ndarray(),
        reach: ti.f32,
    ):
        for k in range(pairs.shape[0]):
            x = ti.Vector([pairs[k, 0], pairs[k, 1], pairs[k, 2]])
            x_j = ti.Vector([pairs[k, 3], pairs[k, 4], pairs[k, 5]])
            found[k, 0] = self.apertures.crossed(x, x_j, self.apertures.near(x, reach))
            found[k, 1] = self.apertures.crossed(x, x_j, (1 << MAX_OPENINGS) - 1)


def test_openings_out_of_reach_hide_no_image(through_flow):
    """Of the images within the kernel's reach, openings that are near() hide as many as all."""
    rng, reach = np.random.default_rng(0), 2.45 * D
    pairs = rng.uniform(0.0, 0.3, (20000, 6)).astype(np.float32)
    pairs[:, [1, 4]] *= reach / 0.3
    image = pairs[:, 3:] * np.array([1.0, -1.0, 1.0])
    pairs = np.ascontiguousarray(pairs[np.linalg.norm(pairs[:, :3] - image, axis=1) < reach])
    found = np.zeros((len(pairs), 2), np.int32)
    Hidden(parts(through_flow).openings.apertures).find(pairs, found, reach)
    assert len(pairs) > 300 and 0.1 < (found[:, 1] != 0).mean() < 0.9
    assert np.array_equal(found[:, 0], found[:, 1])


def test_energy_that_enters_is_recorded():
    settled, radius = 0.5, 0.02
    tap = Opening(
        np.array([0.2, 0.27, 0.2]), DOWN, (radius, radius), True,
        lambda time: 1.0 if time >= settled else 0.0,
    )  # fmt: skip
    sim = simulate(tap, height=0.04)
    record(sim, settled)
    # Particles enter every 0.05 s and fall for 0.15 s, so that none meets the water in this time.
    ledger = record(sim, 0.12, frame=0.005)
    energies = np.array([entry.energy for entry in ledger.entries])
    assert ledger.entries[-1].inflow_mass > 0.1
    particle_energy = sim.plan.specs[0].mass * (0.5 * 1.0**2 + 9.81 * 0.27)
    assert np.abs(np.diff(energies)).max() < 1e-4 * particle_energy


def test_the_volume_flow_of_an_inflow_is_area_times_speed():
    """This holds for a disc and a rectangle whose areas are not whole numbers of particles."""
    wide = Opening(
        np.array([0.0, 0.1, 0.2]), np.array([1.0, 0, 0]), (0.055, 0.043), True, lambda time: 0.5,
        np.eye(3)[[1, 2]],
    )  # fmt: skip
    for opening in (wide, disc(FLOOR, UP, True, 0.5, 0.05)):
        sim = simulate(opening)
        entered = record(sim, 0.5).entries[-1].inflow_mass
        sheet = len(opening.sites(sim.layers.specs[0])[0]) * sim.layers.specs[0].mass
        assert entered == pytest.approx(1000.0 * opening.area * 0.5 * 0.5, abs=1.1 * sheet)
        sim.close()


def test_a_closed_inflow_holds_the_water():
    """An inflow of speed 0 acts as a floor: no water enters, and the water is nearly at rest."""
    sim = simulate(disc(FLOOR, UP, True, 0.0))
    ledger = record(sim, 0.5)
    assert ledger.entries[-1].inflow_mass == 0.0
    assert ledger.entries[-1].kinetic < 0.02 * ledger.entries[-1].mass
    assert sim.particles.numpy("x")[:, 1].min() > -ZONE * D


def test_water_in_pipes_is_no_error_of_the_initial_mass():
    """Regression: `fountain` was said to begin with 1 % too much water, that in its pipe."""
    scene = load_scene("fountain")
    sim = build_simulation(scene)
    laid = water_mass(scene, sim)
    assert sum(sim.counts()) > len(sim.initial["x"])
    assert laid["mass_laid_error"] == pytest.approx(0.0, abs=1e-3)


def test_water_leaves_a_hole_at_the_speed_of_torricelli():
    sim = simulate(disc(FLOOR, DOWN, False, None, 0.1), height=0.28)
    ledger = record(sim, 0.25)
    entry = ledger.entries[-1]
    x, v = sim.particles.numpy("x"), sim.particles.numpy("v")
    jet = x[:, 1] < -0.2
    head = entry.mass / 160.0 - x[jet, 1].mean()
    assert jet.sum() > 3
    assert np.linalg.norm(v[jet], axis=1).mean() == pytest.approx(math.sqrt(19.62 * head), rel=0.1)
    assert entry.outflow_mass > 1.0
    assert sim.contact.leaked() == 0


def test_a_pump_takes_its_rate_only_where_water_is_near():
    opening = disc(FLOOR, DOWN, False, 0.4)
    sim = simulate(opening, height=0.28)
    record(sim, 0.5)
    assert sim.rim.outflow == pytest.approx(500.0 * opening.area * 0.4, abs=0.065)
    assert sim.particles.numpy("x")[:, 1].min() > 0.0
    high = disc((0.2, 0.38, 0.2), DOWN, False, 0.4)
    sim.add_opening(high, GRAVITY)
    sim.remove_opening(opening)
    before = sim.rim.outflow
    record(sim, 0.2)
    assert sim.rim.outflow == before


def test_a_drain_in_the_box_removes_water_without_drops():
    sim = simulate(disc((0.2, 0.14, 0.2), DOWN, False, None, 0.08), height=0.28)
    before = sim.particles.count
    record(sim, 0.2)
    assert sim.rim.outflow == pytest.approx(
        (before - sim.particles.count) * sim.layers.specs[0].mass
    )
    assert sim.rim.outflow > 1.0
    assert not (sim.rim.drops.life.to_numpy() > 0.0).any()


def test_a_full_pool_slows_the_inflow_with_a_message():
    opening = disc(FLOOR, UP, True, 0.5)
    sim = simulate(opening, capacity=560)
    ledger = record(sim, 0.5)
    assert sim.particles.count <= 560
    assert "the pool of 560 particles is full" in (sim.openings.message() or "")
    assert ledger.entries[-1].kinetic < 0.02 * ledger.entries[-1].mass
    assert ledger.mass_change() == pytest.approx(0.0, abs=1e-6)
    sim.reset()
    assert sim.openings.message() is None


@pytest.mark.parametrize("ball", (None, Ball(np.full(3, 0.2), 0.1)), ids=("water", "ball"))
def test_a_full_box_stops_the_inflow_with_a_message(ball):
    """Regression: a tap filled a closed box to twice the density."""
    opening, bodies = disc(FLOOR, UP, True, 1.0), [ball] if ball else []
    x = block_of((0.4, 0.32, 0.4), D)
    x = x[[not ball or np.linalg.norm(c - 0.2) > 0.11 for c in x]]
    sim = water(SIZE, [spec_of(D)], x, openings=[opening], capacity=4000, bodies=bodies)
    record(sim, 1.0)
    pipe = ZONE * D * opening.area
    space = math.prod(SIZE) + pipe - (4.0 / 3.0 * math.pi * 0.1**3 if ball else 0.0)
    assert 0.93 * space < sim.particles.count * D**3 <= space
    assert "the box is full" in (sim.openings.message() or "")
    assert Ledger(sim).record(GRAVITY).solver_residual_mean < 0.02


def test_openings_are_added_and_removed_in_a_running_simulation():
    sim = simulate(disc(FLOOR, UP, True, 0.3))
    record(sim, 0.1)
    tap = disc((0.2, 0.38, 0.2), DOWN, True, 0.5, 0.05)
    with pytest.raises(ValueError, match="spacings of 0.04 m behind it"):
        sim.add_opening(tap, GRAVITY)
    tap = disc((0.2, 0.26, 0.2), DOWN, True, 0.5, 0.05)
    compiled: list[str] = []
    with watch_compiling(compiled.append):
        sim.add_opening(tap, GRAVITY)
        entered = record(sim, 0.2).entries[-1].inflow_mass
        sim.remove_opening(tap)
        record(sim, 0.1)
    assert not compiled
    assert entered > 0.5
    assert [Valve(0.5, until=0.3)(t) for t in (0.2, 0.4)] == [0.5, 0.0]
    with pytest.raises(ValueError, match="needs a Valve"):
        sim.add_opening(Opening(FLOOR, DOWN, (0.1, 0.1), False, lambda time: 1.0), GRAVITY)
    assert len(sim.openings.all) == 1
    sim.reset()
    assert len(sim.openings.all) == 1 and sim.time == 0.0


def test_the_solver_residual_leaves_out_particles_in_inflows():
    """Where a body or other water meets an inflow, nothing can lower the density in its pipe."""
    sim = simulate(disc(FLOOR, UP, True, 0.5))
    record(sim, 0.2)
    state = sim.particles.state()
    deepest = np.argsort(state["x"][:, 1])[:6]
    assert (state["x"][deepest, 1] < 0.0).all()
    middle = state["x"][deepest].mean(axis=0)
    state["x"][deepest] = middle + 0.3 * (state["x"][deepest] - middle)
    place(sim, **state)
    entry = Ledger(sim, density_every=0.0).record(GRAVITY)
    assert sim.particles.numpy("density").max() > 1.3 * 1000.0
    assert entry.solver_residual_max < 0.1


def test_layers_adapt_between_inflow_and_hole():
    flows = (
        "inflows=[{centre=[0.2, 0, 0.4], radius=0.12, speed=0.8}]",
        "outflows=[{centre=[0.6, 0, 0.4], radius=0.12}]",
    )
    sim = build_simulation(load_scene("drop", (*SPLASH, *flows, "duration=2.0")))
    ledger = record(sim, 0.7)
    assert sim.openings.all[0].layer > 0
    assert ledger.mass_change() == pytest.approx(0.0, abs=1e-6)
    assert ledger.entries[-1].outflow_mass > 1.0 and ledger.entries[-1].inflow_mass > 5.0
    assert sum(sim.solver.adaptation.totals) > 10
    assert len(np.unique(sim.particles.numpy("id"))) == sim.particles.count


def test_a_tap_whose_pipe_reaches_above_the_lid_is_refused():
    """Regression: particles above the lid were reported as leaked water at the start."""
    scene = load_scene("drop", ("box.open=false",))
    spacing, height = layer_specs(scene)[0].spacing, scene.box.size[1]
    tap = "inflows=[{{centre=[0.4, {}, 0.4], radius=0.1, speed=1, layer=0}}]"
    load_scene("drop", ("box.open=false", tap.format(height - (ZONE + 0.01) * spacing)))
    with pytest.raises(SceneError, match=r"inflows\.0: reaches, 3 spacings .* beyond"):
        load_scene("drop", ("box.open=false", tap.format(height - (ZONE - 0.3) * spacing)))


def test_a_run_ends_where_the_speed_of_an_inflow_is_no_number():
    """Regression: beyond the duration the inflow stopped without a word."""
    change = "inflows=[{centre=[0.4, 0, 0.4], radius=0.1, speed='sqrt(0.3 - t)'}]"
    scene = load_scene("drop", (change, "duration=0.1"))
    made, *_ = openings(scene, layer_specs(scene))
    assert made.speed(0.2) > 0.0
    with pytest.raises(ExpressionError, match=r"inflows\.0\.speed: .* not a number at t = 0.301 s"):
        made.speed(0.301)


def test_a_wall_shows_no_body_to_water_in_a_pipe_beyond_it():
    """Regression: the floor mirrored the ball into the pipe, to 1.9 times the rest density."""
    ball = Ball(np.array((0.2, 0.105, 0.2)), 0.08)
    sim = simulate(disc(FLOOR, UP, True, 0.5), bodies=[ball])
    sim.measure_density()
    in_pipe = sim.particles.numpy("x")[:, 1] < 0.0
    assert in_pipe.sum() > 5
    assert sim.particles.numpy("density")[in_pipe].max() < 1.1 * 1000.0


def test_an_inflow_in_a_body_is_refused():
    tap = "inflows=[{centre=[1.0, 0, 0.3], radius=0.02, speed=1}]"
    body = "bodies=[{lo=[0.9, 0, 0.2], hi=[1.1, 0.4, 0.4]}]"
    with pytest.raises(SceneError, match=r"inflows.0: is inside a body"):
        build_simulation(load_scene("pillar", (tap, body)))
