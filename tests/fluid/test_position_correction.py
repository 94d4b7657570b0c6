"""Position correction: crowds, relative speeds, velocity exchange, background, mixtures."""

import numpy as np
import pytest

from msph.fluid.particles.layers import LayerSpec
from msph.fluid.projection.position_correction import CROWDED_EXCESS, FULL_MOTION
from tests.fluid.fluid_kit import (
    WEIGHTLESS,
    advance,
    all_pairs,
    in_order,
    lattice,
    listed,
    masses,
    of_layers,
    place,
    simulate,
    vectors,
)


def test_crowds_are_crowded_particles_and_their_neighbours(collision):
    """`crowding` is 2 for particles of an excess above CROWDED_EXCESS and their neighbours, 1 for
    neighbours of those, and 0 elsewhere."""
    advance(collision, 4, WEIGHTLESS)
    solver, p = collision.solver, collision.particles
    near = p.numpy("x").copy()
    squeezed = near[:, 0] < np.median(near[:, 0])
    near[squeezed] = 0.98 * near[squeezed] + 0.02 * near[squeezed].mean(axis=0)
    place(collision, x=near)
    solver.position_correction._mark_crowds(p.count)
    _, _, r, h = all_pairs(collision)
    met = listed(r, h)
    crowded = p.numpy("density") / 1000.0 - 1.0 > CROWDED_EXCESS
    corrected = (met & crowded).any(axis=1)
    displaced = (met & corrected).any(axis=1)
    assert crowded.any() and not displaced.all()
    assert np.array_equal(p.numpy("crowding"), np.where(corrected, 2, np.where(displaced, 1, 0)))
    # To rounding of c, in single precision.
    excess = p.numpy("density").max() / 1000.0 - 1.0
    assert solver.density.largest_excess == pytest.approx(excess, abs=1e-6)


def test_velocity_exchange_of_crowds_adds_no_energy(collision):
    """Regression: particles gave away several times their relative velocity, which grew from step
    to step; a tap deep in a pool blew up all water."""
    solver, p = collision.solver, collision.particles
    x, v = (0.8 + 0.63 * (p.numpy("x") - 0.8)), np.random.default_rng(0).normal(size=(p.count, 3))
    place(collision, x=x.astype(np.float32), v=v.astype(np.float32))
    solver.position_correction.find(1 / 300)
    p.position_correction.fill(0.0)  # particles stay, so that the exchange repeats
    mass, momenta, energies = masses(collision)[:, None], [], []
    for _ in range(30):
        v = p.numpy("v").astype(float)
        momenta.append((mass * v).sum(axis=0))
        energies.append((mass * v**2).sum())
        solver.position_correction.apply(1 / 300)
    assert momenta[-1] == pytest.approx(momenta[0], abs=1e-4)
    assert (np.diff(energies) < 1e-6 * energies[0]).all()
    assert energies[-1] < 0.5 * energies[0]


def test_relative_speed_is_the_largest_past_neighbours_and_walls(collision):
    advance(collision, 6, WEIGHTLESS)
    solver, p = collision.solver, collision.particles
    x = p.numpy("x")
    place(collision, x=x - (x[:, 0].min() - np.float32(0.01)) * np.float32([1, 0, 0]))
    (x, v), (_, _, r, h) = vectors(collision), all_pairs(collision)
    solver.position_correction.find(0.0)
    solver.position_correction.apply(0.0)
    near = listed(r, h)
    passing = (np.linalg.norm(v[:, None] - v, axis=2) * near).max(axis=1)
    wall = np.where(x[:, 0] < np.diag(h), np.abs(v[:, 0]), 0.0)
    assert (wall > passing).any() and (passing > 2.0).any()
    expected = np.maximum(passing, wall)
    assert np.allclose(p.numpy("relative_speed"), expected, rtol=1e-3, atol=1e-5)


def test_background_pressure_is_weaker_in_calm_water(collision):
    """Regression: with full pressure, waves half a spacing high oscillated 5 % too slowly."""
    p, dt = collision.particles, 1 / 300
    brisk = FULL_MOTION * max(s.spacing for s in collision.layers.specs) / dt

    def spread(speed, dt):
        p.v.fill(speed / np.sqrt(3.0))
        collision.solver.measure_density()
        collision.solver.position_correction.find(dt)
        return p.numpy("position_multiplier").astype(float).sum()

    full = spread(0.0, 0.0)
    assert spread(1.01 * brisk, dt) == pytest.approx(full, rel=1e-5)
    assert 0.0 < spread(0.0, dt) < 0.6 * full
    assert spread(0.0, dt) < spread(0.4 * brisk, dt) < 0.95 * full


def mixture(halvings, cells):
    """Returns points and layers of a cube of 1 m that consists of cells of equal volume; half of
    them, chosen at random, are halved `halvings` times."""
    rng, d = np.random.default_rng(0), 1.0 / cells
    coarse = lattice((cells,) * 3, d)
    chosen = rng.permutation(len(coarse)) % 2 == 0
    fine, edges = coarse[chosen], np.full((chosen.sum(), 3), d)
    for _ in range(halvings):
        along = (edges * rng.uniform(1.0, 1.1, edges.shape)).argmax(axis=1)
        halved = np.where(np.eye(3, dtype=bool)[along], 0.5 * edges, edges)
        offset = 0.5 * (edges - halved)
        fine, edges = np.concatenate([fine - offset, fine + offset]), np.tile(halved, (2, 1))
    x = np.concatenate([fine, coarse[~chosen]])
    x += rng.normal(0.0, 0.02 * d, x.shape)
    return x.clip(0.01, 0.99), np.repeat([0, 1], [len(fine), (~chosen).sum()])


# Volume of the particles over the volume of a cube, so large that no gaps remain; c equals this
# value if volumes add up.
FULL = 1.02


def full_cube(halvings, cells, rounds):
    """Yields a cube of a mixture in each round of the position correction, with known densities."""
    mass = FULL * 1000.0 / cells**3
    specs = [LayerSpec(mass / 2**halvings, 1000.0, 2.5), LayerSpec(mass, 1000.0, 2.5)]
    sim = simulate((1.0, 1.0, 1.0), specs, *mixture(halvings, cells))
    solver = sim.solver
    for _ in range(rounds):
        solver.measure_density()
        solver.position_correction.find(0.0)
        yield sim
        solver.position_correction.apply(0.0)
        solver.particles_moved()


def test_water_keeps_its_initial_velocities_while_crowds_are_moved_apart():
    x, layer = mixture(1, 6)
    v = np.random.default_rng(1).normal(size=x.shape).astype(np.float32)
    specs = [LayerSpec(m / 6**3, 1000.0, 2.5) for m in (500.0, 1000.0)]
    sim = simulate((1.0,) * 3, specs, x, layer, v)
    start, found = (np.sort(each, axis=0) for each in (np.float32(x), sim.particles.numpy("x")))
    assert (found != start).any()
    assert (np.sort(sim.particles.numpy("v"), axis=0) == np.sort(v, axis=0)).all()


@pytest.mark.parametrize("halvings", [1, 2])
def test_mixtures_of_unlike_particles_fill_the_sum_of_their_volumes(halvings):
    """Mixtures of mass ratio 2 and 4 keep their volume to 0.3 %. Layers whose mixtures lose volume
    are driven into each other by their weight and dissolve."""
    seen = []
    for sim in full_cube(halvings, cells=7, rounds=250):
        volume, density = of_layers(sim, "volume"), sim.particles.numpy("density")
        seen.append(np.average(density, weights=volume) / 1000.0)
    assert np.mean(seen[200:]) / FULL == pytest.approx(1.0, abs=3e-3)


def test_uniform_compression_raises_the_density_as_it_reduces_the_volume():
    """The density rises by (1 - 0.001)^-3 - 1 to 0.2 % of the rise. Otherwise the pressure that
    bears a weight would be wrong by the missing rise."""
    *_, sim = full_cube(0, cells=9, rounds=120)
    p, solver, squeeze = sim.particles, sim.solver, 1e-3

    def densities():
        solver.particles_moved()
        solver.measure_density()
        return in_order(p, "x", "density")

    x, before = densities()
    p.x.from_numpy((0.5 + (1.0 - squeeze) * (p.x.to_numpy() - 0.5)).astype(np.float32))
    gain = densities()[1] / before - 1.0
    inner = (np.abs(x - 0.5) < 0.5 - 2.5 / 9).all(axis=1)
    assert inner.sum() > 50
    assert gain[inner].mean() == pytest.approx((1.0 - squeeze) ** -3 - 1.0, rel=2e-3)
