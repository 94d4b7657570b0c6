"""Tests of each shipped scene: no water leaves the box, and the scene passes a check of its own."""

import math

import numpy as np
import pytest
from scipy.optimize import brentq

from msph.constants import DEFAULT_SCENE
from msph.launches import watch_compiling
from msph.measure.probes import FrontProbe, build_probes
from msph.measure.snapshot import Snapshot
from msph.options import AS_GIVEN
from msph.scene import load_scene
from msph.scene.library import shipped_scenes
from msph.scene.quality import at_quality
from msph.scene.wavemakers import wave_number
from msph.stage.headless import Headless
from msph.stage.loop import run
from msph.stage.row import Row
from msph.stage.show import Show
from tests.fluid.fluid_kit import masses
from tests.tiers import slow_but

FRAME = 1.0 / 60.0
G = 9.81
# Qualities of scenes that are simulated for seconds; bench/scenes.py runs them at quality large.
QUALITY = {"duck": "medium", "lock": "small", "rolled": "medium", "waves": "medium"}


class Seen:
    """A shipped scene that runs frame by frame, at its quality in QUALITY or as its file is."""

    def __init__(self, name):
        scene = at_quality(load_scene(name), QUALITY.get(name, AS_GIVEN), name)
        self.show = Show(scene, FRAME, density_every=math.inf)
        self.simulation, self.ledger = self.show.simulation, self.show.ledger
        self.record()

    def record(self):
        self.ledger.record(self.show.gravity())

    def run(self, frames):
        """Runs further frames."""
        run(Row([self.show]), Headless(frames))

    @property
    def x(self):
        return self.simulation.particles.numpy("x").astype(float)

    @property
    def m(self):
        """Masses [kg], (n,)."""
        return masses(self.simulation)

    def centre(self, where=None):
        """Returns the centre of mass [m] of all water, or of the particles in a mask."""
        where = np.ones(len(self.m), bool) if where is None else where
        return np.average(self.x[where], axis=0, weights=self.m[where])

    def depth(self):
        """Returns the depth [m] of all water, spread evenly over the box's floor."""
        floor = self.simulation.size[0] * self.simulation.size[2]
        return self.m.sum() / self.simulation.layers.specs[0].density / floor

    def pressure(self, *points):
        """Returns the mean pressure [Pa] at points [m]."""
        return Snapshot.of(self.simulation).pressures(np.array(points)).mean()


def runs_to_the_lower_side(seen):
    """Checks that the rocking pool's centre of mass moves along the horizontal part of gravity."""
    start, lean = seen.centre(), 0.0
    for _ in range(25):
        seen.run(1)
        lean += seen.show.gravity()[0]
    moved = seen.centre() - start
    assert abs(lean) > 1.0
    assert moved[0] * np.sign(lean) > 0.005
    # The pool rocks about z, so gravity has no component along z.
    assert abs(moved[2]) < 0.1 * abs(moved[0])


def is_hydrostatic_and_still(seen):
    """Checks p = rho g (H - y) at four depths, that the energy never rises, and that motion is
    slight: particles leave the initial lattice and come to rest again."""
    depth, (x, _, z) = seen.depth(), seen.simulation.size
    heights = np.array([0.0, 0.25, 0.5, 0.75]) * depth
    found = []
    for _ in range(120):
        seen.run(1)
        found.append([seen.pressure((0.5 * x, y, 0.5 * z)) for y in heights])
    error = np.mean(found, axis=0) - 1000.0 * G * (depth - heights)
    assert np.abs(error).max() < 0.03 * 1000.0 * G * depth
    energies = np.array([e.energy for e in seen.ledger.entries])
    assert np.diff(energies).max() < 1e-4 * energies[0]
    kinetic = np.array([e.kinetic for e in seen.ledger.entries])
    assert kinetic.max() < 2e-4 * energies[0] and kinetic[-20:].mean() < 0.95 * kinetic.max()


def has_the_weight_of_its_water_on_the_floor(seen):
    """Checks p = rho g H on the floor of a pool of seven layers, within 3 %."""
    x, _, z = seen.simulation.size
    places = [(a * x, 0.0, b * z) for a in (0.25, 0.75) for b in (0.25, 0.75)]
    found = []
    for _ in range(10):
        seen.run(1)
        found.append(seen.pressure(*places) / (-seen.show.gravity()[1] * 1000.0))
    assert np.mean(found) == pytest.approx(seen.depth(), rel=0.03)


def its_ball_falls_freely(seen):
    """Checks v = v0 - g t and y = y0 + v0 t - g t^2/2 of the ball's centre above the pool.

    Regression: y was wrong by g t dt/2, 15 % of the fall that is checked here.
    """
    scene = load_scene("drop")
    gap = scene.water[1].centre[1] - scene.water[1].radius - scene.water[0].hi[1]
    level = scene.water[0].hi[1] + 0.3 * gap
    v0, above = scene.water[1].velocity[1], seen.x[:, 1] > level
    start, mass = seen.centre(above), seen.m[above].sum()
    seen.run(3)
    t, above = seen.simulation.time, seen.x[:, 1] > level
    assert seen.m[above].sum() == pytest.approx(mass, rel=1e-6)
    fallen = seen.centre(above) - start
    assert fallen[1] == pytest.approx(v0 * t - 0.5 * G * t**2, abs=2e-3 * G * t**2)
    v = seen.simulation.particles.numpy("v").astype(float)[above]
    assert np.average(v[:, 1], weights=seen.m[above]) == pytest.approx(v0 - G * t, rel=1e-3)
    assert np.abs(fallen[[0, 2]]).max() < 0.01 * abs(fallen[1])


def its_front_runs_and_no_water_is_lost(seen):
    """Checks that the front advances in every tenth of a second, slower than Ritter's bound
    2 sqrt(g h), and that the mass is constant."""
    probe, mass = FrontProbe("", "+x"), seen.m.sum()
    height = seen.x[:, 1].max()
    places = [probe.read(Snapshot.of(seen.simulation))[0]]
    for _ in range(3):
        seen.run(6)
        places.append(probe.read(Snapshot.of(seen.simulation))[0])
    assert np.all(np.diff(places) > 0.0) and places[-1] > 1.2 * places[0]
    assert np.diff(places).max() < 2.0 * np.sqrt(G * height) * 6 * FRAME
    assert seen.m.sum() == pytest.approx(mass, rel=1e-9)


def its_water_divides_round_the_pillar(seen):
    """Checks that about as much water passes on each side of the pillar, and none is in a body."""
    pillar = load_scene("pillar").bodies[0]
    (x0, _, z0), (x1, _, z1) = pillar.lo, pillar.hi
    while seen.simulation.time < 0.7:
        seen.run(6)
        assert seen.simulation.boundary.free(seen.x).all()
    x, m = seen.x, seen.m
    beside = (x[:, 0] > x0) & (x[:, 0] < x1)
    left, right = (m[beside & side].sum() for side in (x[:, 2] < z0, x[:, 2] > z1))
    assert min(left, right) > 0.005 * m.sum()
    assert left == pytest.approx(right, rel=0.35)


def its_container_holds_all(seen):
    """Checks that no particle leaves the mesh while the ball of water falls and the bowl rocks."""
    mass = seen.m.sum()
    for _ in range(5):
        seen.run(4)
        assert seen.simulation.boundary.free(seen.x).all()
    assert seen.m.sum() == pytest.approx(mass, rel=1e-9)


def gains_no_more_energy_than_its_plate_works(seen):
    """Checks that the water's energy rises by no more than the work of the bodies that push it."""
    for _ in range(20):
        seen.run(1)
    entries = seen.ledger.entries
    work = np.array([e.wall_work for e in entries])
    gained = np.array([e.kinetic + e.potential for e in entries]) - entries[0].energy
    assert work[-1] > 0.0 and gained[-1] > 0.0
    assert np.all(gained < work + 0.02 * work.max())


def loses_the_energy_of_its_fall(seen):
    """Checks that the kinetic energy of falling honey is at most the energy of its fall, and that
    most of it is dissipated soon after the impact; water would keep it for seconds.

    No kernel is compiled during the run, nor by the correction of crowded particles, which has
    kernels of its own.
    """
    seen.show.warm_up()
    seen.record()
    compiled = []
    with watch_compiling(compiled.append):
        _falls_and_loses_its_energy(seen)
        solver = seen.simulation.solver
        solver.measure_density()
        solver.density.largest_excess = 0.1
        solver.position_correction.find(1e-3)
    assert not compiled


def _falls_and_loses_its_energy(seen):
    scene = load_scene("honey")
    start = seen.ledger.entries[0].potential
    assert seen.ledger.entries[0].kinetic == 0.0
    while seen.simulation.time < 0.2:
        seen.run(1)
    entries = seen.ledger.entries
    fallen = start - np.array([e.potential for e in entries])
    kinetic = np.array([e.kinetic for e in entries])
    assert np.all(kinetic < fallen + 1e-3 * fallen.max())
    peak = kinetic.argmax()
    assert kinetic[peak] > 0.5 * fallen[peak] and kinetic[-1] < 0.1 * kinetic[peak]
    assert scene.projection.viscosity > 1.0


def its_bodies_float_by_their_densities(seen):
    """Checks that each ball floats as high above the level as Archimedes' principle predicts, and
    that the duck is upright."""
    scene, floating = load_scene("duck"), seen.simulation.boundary.floating
    heights = []
    while seen.simulation.time < 2.0:
        seen.run(6)
        if seen.simulation.time > 1.0:
            heights.append(floating.x[:, 1].copy())
    level = (seen.m.sum() + floating.mass.sum()) / 1000.0 / (scene.box.size[0] * scene.box.size[2])
    for k, body in enumerate(scene.bodies[1:], 1):
        submerged = (body.density / 1000.0) * 4.0 / 3.0 * np.pi * body.radius**3
        draft = brentq(
            lambda d, r=body.radius, v=submerged: np.pi * d**2 * (r - d / 3.0) - v,
            0.0,
            2.0 * body.radius,
        )
        off = np.mean(heights, axis=0)[k] - (level + body.radius - draft)
        assert abs(off) < 0.1 * 2.0 * body.radius
    assert floating.turn[0, 1, 1] > 0.9


def keeps_its_water_and_rises_by_its_speed(seen):
    """Checks that the drain removes as much water as the jet adds, and that the jet, which leaves
    the floor under the pressure of the water, rises v^2/(2 g) above the water level."""
    mass, depth = seen.m.sum(), seen.depth()
    seen.run(round(2.0 / FRAME))
    assert seen.m.sum() == pytest.approx(mass, rel=0.02)
    assert seen.ledger.mass_change() == pytest.approx(0.0, abs=1e-6)
    speed = seen.simulation.openings.speeds[0]
    over = np.linalg.norm(seen.x[:, [0, 2]] - 0.4, axis=1) < 0.1
    assert np.percentile(seen.x[over, 1], 95) == pytest.approx(
        depth + speed**2 / (2.0 * G), rel=0.15
    )


def makes_its_basins_level_and_opens_its_gate(seen):
    """Checks that the basins become level, and that the lifted gate lowers the level everywhere by
    the volume that it had displaced (Archimedes)."""
    gate, length = load_scene("lock").bodies[0], seen.simulation.size[0]
    left, right = gate.lo[0], gate.hi[0]

    def levels(*spans):
        x = seen.x[seen.x[:, 1] > 0.0]
        return [2.0 * x[(x[:, 0] > lo) & (x[:, 0] < hi), 1].mean() for lo, hi in spans]

    seen.run(round(5.5 / FRAME))
    assert levels((0.0, left), (right, length)) == pytest.approx([0.24, 0.24], rel=0.03)
    rates = [seen.simulation.rim.outflow, seen.ledger.entries[-1].inflow_mass]
    assert rates == pytest.approx([17.92, 17.92], abs=1.0)
    seen.run(round(3.0 / FRAME))
    assert gate.lo[1] + seen.simulation.boundary.pose(0)[0][1] > 0.3
    level = 0.24 * (length - (right - left)) / length
    upper, passage, lower = levels((0.0, left), (left, right), (right, length))
    assert [upper, lower] == pytest.approx([level] * 2, rel=0.04)
    assert passage == pytest.approx(level, rel=0.12)  # the passage is only three particles long
    assert seen.ledger.mass_change() == pytest.approx(0.0, abs=1e-6)


def follows_the_roll(seen):
    """Checks that the water moves with the period of the roll, farther than on a tilted floor."""
    scene, period = load_scene("rolled"), 98
    seen.run(4 * period)
    x = np.array([e.centre[0] for e in seen.ledger.entries])[-2 * period :]
    assert np.corrcoef(x[:-period], x[period:])[0, 1] > 0.9
    assert np.corrcoef(x[: -period // 2], x[period // 2 :])[0, 1] < -0.7
    length, depth = scene.box.size[0], seen.depth()
    assert 0.5 * np.ptp(x) > 1.2 * np.tan(np.radians(4.0)) * length**2 / (12.0 * depth)


def makes_waves_as_high_as_theory_says(seen):
    """Checks the ratio of wave height to stroke of a flap, in the first harmonic, against linear
    theory, and that the buoy floats."""
    scene = load_scene("waves")
    maker, depth = scene.wavemakers[0], scene.water[0].hi[1]
    (probe,) = build_probes(scene)
    floating, times, heights = seen.simulation.boundary.floating, [], []
    while seen.simulation.time < 4.0:
        seen.run(2)
        if seen.simulation.time > 2.0:
            times.append(seen.simulation.time)
            heights.append(probe.read(Snapshot.of(seen.simulation))[0])
    kd = wave_number(maker.period, depth, G) * depth
    s, c = np.sinh(kd), np.cosh(kd)
    ratio = 4.0 * s * (kd * s - c + 1.0) / (kd * (np.sinh(2.0 * kd) + 2.0 * kd))
    angle = 2.0 * np.pi / maker.period * np.array(times)
    basis = np.stack([np.ones_like(angle), np.cos(angle), np.sin(angle)], axis=1)
    found = np.linalg.lstsq(basis, heights, rcond=None)[0]
    assert 2.0 * np.hypot(*found[1:]) == pytest.approx(ratio * maker.stroke, rel=0.2)
    assert abs(floating.x[0, 1] - depth) < 0.1


FACTS = {
    "bowl": its_container_holds_all,
    "dam_break": its_front_runs_and_no_water_is_lost,
    "deep": has_the_weight_of_its_water_on_the_floor,
    "drop": its_ball_falls_freely,
    "duck": its_bodies_float_by_their_densities,
    "fountain": keeps_its_water_and_rises_by_its_speed,
    "honey": loses_the_energy_of_its_fall,
    "lock": makes_its_basins_level_and_opens_its_gate,
    "paddle": gains_no_more_energy_than_its_plate_works,
    "pillar": its_water_divides_round_the_pillar,
    "pool": runs_to_the_lower_side,
    "pool_2x": runs_to_the_lower_side,
    "rolled": follows_the_roll,
    "still": is_hydrostatic_and_still,
    "waves": makes_waves_as_high_as_theory_says,
}


def test_every_shipped_scene_has_a_check():
    assert set(FACTS) == set(shipped_scenes())


def check_bounds(seen):
    """Checks that no particle has been outside of the box or fast."""
    assert not any(e.outside for e in seen.ledger.entries)
    assert max(e.top_speed for e in seen.ledger.entries) < 20.0


@pytest.mark.parametrize("name", shipped_scenes())
def test_a_shipped_scene_starts_and_stays_in_its_box(name):
    seen = Seen(name)
    seen.run(6)
    check_bounds(seen)
    assert np.abs(seen.ledger.mass_change()) < 1e-6


@pytest.mark.parametrize("name", slow_but(("deep", "drop"), FACTS))
def test_a_shipped_scene_passes_its_check(name):
    seen = Seen(name)
    start = seen.x.mean(axis=0)
    FACTS[name](seen)
    if name == DEFAULT_SCENE:
        while seen.simulation.time < 1.0 - 0.5 * FRAME:
            seen.run(1)
        assert np.linalg.norm(seen.x.mean(axis=0) - start) > 0.05
    check_bounds(seen)
