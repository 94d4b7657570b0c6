"""Images in walls and bodies: complete, equal to each other, with exact gradients."""

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from msph.errors import BlowUpError
from msph.fluid.boundary.rigid_bodies import Ball, Block
from msph.fluid.particles.images import image_capacity
from msph.fluid.particles.layers import LayerSpec
from msph.fluid.projection.solver import Projection
from tests.boundary_kit import boundary_of, solid
from tests.fluid.fluid_kit import (
    in_order,
    lattice,
    listed,
    parts,
    simulate,
    spans,
    spec_of,
    sum_of_entries,
)

D = 0.04
FINE, COARSE = spec_of(D), LayerSpec(2000.0 * D**3, 1000.0, 2.45)


@pytest.fixture(autouse=True)
def unarranged(monkeypatch):
    """Particles stay where a test puts them."""
    monkeypatch.setattr(Projection, "arrange", Projection.measure_density)


def water(counts, disturbance=0.2):
    """Returns positions on a disturbed lattice of spacing D at the origin, and random layers."""
    rng = np.random.default_rng(0)
    x = lattice(counts, D)
    x += rng.uniform(-disturbance, disturbance, x.shape) * D
    return x.astype(np.float32), rng.integers(0, 2, len(x)).astype(np.int32)


def simulation(x, layer, size, bodies):
    return simulate(size, [FINE, COARSE], x, layer, bodies=bodies)


@pytest.mark.parametrize(("axis", "far"), [(0, False), (0, True), (1, False), (2, True)])
def test_a_block_along_a_wall_mirrors_as_the_wall_does(axis, far):
    """Also in the block's edges with the other walls."""
    x, layer = water((8, 6, 7))
    size, thick = np.array((8, 12, 7)) * D, 5.0 * D
    found = []
    for block in (False, True):
        larger, shift = size.copy(), np.zeros(3)
        larger[axis] += thick * block
        lo, hi = np.zeros(3), larger.copy()
        if far:
            lo[axis] = size[axis]
        else:
            hi[axis], shift[axis] = thick, thick * block
        place = (x + shift).astype(np.float32)
        sim = simulation(place, 0 * layer, tuple(larger), [Block(lo, hi)] if block else [])
        sim.measure_density()
        found.append(in_order(sim.particles, "density", "gradient", "diagonal"))
        sim.close()
    for one, other in zip(*found, strict=True):
        assert np.abs(one - other).max() < 1e-3 * np.abs(one).max()


def test_images_sum_to_the_share_and_only_particles_at_faces_have_links():
    """The gradients of a particle's neighbours and images add up to its gradient. The bounding
    balls of long blocks reach most particles, but only particles at their faces are linked."""
    (x, layer), size = water((12, 4, 12)), np.array((12, 8, 12)) * D
    bars = [Block(np.array((0.0, 0.0, z)), np.array((0.48, 0.3, z + D))) for z in (2 * D, 5 * D)]
    apart = boundary_of(size, [FINE, COARSE], bars).free(x, 0.3 * D)
    sim = simulation(x[apart], 0 * layer[apart], tuple(size), bars)
    sim.measure_density()
    total = sim.particles.numpy("gradient")
    found = sum_of_entries(sim, "neighbours") + sum_of_entries(sim, "images")
    assert np.abs(found - total).max() < 1e-4 * np.abs(total).max()
    assert 0 < parts(sim).links.found[None] < 2 * sim.particles.count


@pytest.mark.parametrize("counts", [(12, 12, 12), (4, 4, 200), (3, 3, 400), (4, 24, 24)])
def test_images_complete_the_neighbours_of_a_lattice_between_walls(counts):
    """Also in edges, corners and ducts; the estimated number of places suffices."""
    x, layer = water(counts, disturbance=0.0)
    size = tuple(D * np.array(counts))
    sim = simulation(x, 0 * layer, size, [])
    sim.measure_density()
    assert parts(sim).images.found[None] <= image_capacity(size, [FINE, COARSE], len(x), False)
    steps = np.stack(np.meshgrid(*[np.arange(-3, 4)] * 3), axis=-1).reshape(-1, 3)
    near = np.sum(listed(np.linalg.norm(steps, axis=1), 2.45)) - 1
    counts = [end - begin for begin, end in (spans(sim, "neighbours"), spans(sim, "images"))]
    assert np.all(counts[0] + counts[1] == near)


def test_ratios_of_meshes_are_smooth_where_their_shares_vanish():
    """Regression: shares of meshes are inexact by 3e-4; divided by those of a plane, which vanish
    at the end of the kernel, ratios were random and had slopes of thousands per metre."""
    x, layer = water((12, 6, 9))
    size, mesh = (12 * D, 12 * D, 9 * D), bodies_at_walls()[2:]
    apart = boundary_of(size, [FINE, COARSE], mesh).free(x, 0.06 * D)
    sim = simulation(x[apart], layer[apart], size, mesh)
    sim.measure_density()
    links = parts(sim).links
    slope = np.linalg.norm(links.slope.to_numpy()[: links.found[None]], axis=1)
    assert links.found[None] > 100
    assert slope.max() < 5.0 / D


def bodies_at_walls():
    """Returns a floating block, ball and mesh, each near walls."""
    mesh = trimesh.creation.box((0.1, 0.12, 0.1))
    return [
        Block(np.array((0.02, 0.1, 0.1)), np.array((0.12, 0.2, 0.2)), mass=0.5),
        Ball(np.array((0.42, 0.08, 0.3)), 0.06, mass=0.5),
        solid(mesh, (0.25, 0.14, 0.08), mass=0.5),
    ]


def test_links_hold_the_gradients_by_the_motion_of_bodies():
    """The bodies' shares, summed over the particles with weights, change by -U.G - W.T with the
    displacement U and the rotation W of a body."""
    (x, layer), size = water((12, 6, 9)), (12 * D, 12 * D, 9 * D)
    # Contact keeps particles this far from bodies at least.
    apart = boundary_of(size, [FINE, COARSE], bodies_at_walls()).free(x, 0.06 * D)
    sim = simulation(x[apart], layer[apart], size, bodies_at_walls())
    links, floating = parts(sim).links, sim.boundary.floating
    weights = np.random.default_rng(1).random(len(x))

    def total():
        sim.boundary.restore(0.0, floating.state())
        parts(sim).images.refresh()
        return (weights[sim.particles.numpy("id")] * sim.particles.numpy("body_share")).sum()

    sim.measure_density()
    total()
    n, start, step = links.found[None], floating.state(), 2e-4
    of_link = weights[sim.particles.numpy("id")[links.particle.to_numpy()[:n]]]
    bodies, G, T = (f.to_numpy()[:n] for f in (links.body, links.gradient, links.torque))
    for b in range(3):
        own = bodies == b
        rates = [-(of_link[own, None] * field[own]).sum(axis=0) for field in (G, T)]
        for rate, turns in zip(rates, (False, True), strict=True):
            for axis in range(3):
                sums = []
                for way in (step, -step):
                    floating.restore(start.copy())
                    if not turns:
                        floating.x[b, axis] += way
                    else:
                        turn = Rotation.from_rotvec(way * np.eye(3)[axis]).as_matrix()
                        floating.turn[b] = turn @ floating.turn[b]
                    sums.append(total())
                found = (sums[0] - sums[1]) / (2.0 * step)
                assert found == pytest.approx(rate[axis], abs=0.02 * np.abs(rate).max() + 5e-3)


def test_bodies_at_opposite_walls_have_mirrored_forces():
    """Regression: only walls at the origin mirrored bodies, so that a ball lying at the far wall
    had no images there."""
    x, layer = water((9, 6, 6))
    size, found = np.array((9, 12, 6)) * D, []
    for far in (False, True):
        ball = Ball(np.array((size[0] - 0.07 if far else 0.07, 0.1, 0.12)), 0.06)
        place = x.copy()
        place[:, 0] = size[0] - x[:, 0] if far else x[:, 0]
        sim = simulation(place, layer, tuple(size), [ball])
        sim.measure_density()
        order = np.argsort(sim.particles.numpy("id"))
        (share,) = in_order(sim.particles, "body_share")
        found.append([share, sum_of_entries(sim, "body images")[order]])
        sim.close()
    found[1][1][:, 0] *= -1.0
    for one, other in zip(*found, strict=True):
        assert np.abs(one - other).max() < 1e-3 * np.abs(one).max()


def test_too_many_images_raise_a_blow_up_error(monkeypatch):
    x, layer = water((6, 5, 6))
    sim = simulation(x, layer, (6 * D, 8 * D, 6 * D), [Ball(np.array((0.12, 0.1, 0.12)), 0.06)])
    monkeypatch.setattr(parts(sim).images, "capacity", 10)
    with pytest.raises(BlowUpError, match="mirror particles in .* at most 10"):
        sim.measure_density()
        parts(sim).images.refresh()
