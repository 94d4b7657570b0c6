"""Adaptation with too few particles, of rounded spacings, and of deep water."""

import numpy as np
import pytest

from msph.fluid.adaptivity.bands import AdaptationParameters, with_exact_ratios
from msph.fluid.particles.layers import LayerSpec
from tests.fluid.fluid_kit import advance, coarse_tank, lattice, masses, simulate, spec_of


def rested(capacity):
    """Returns the tank with room for `capacity` particles after 0.5 s, its number of particles, and
    their masses [kg]."""
    sim = coarse_tank(capacity)
    advance(sim, 30)
    return sim, sim.particles.count, masses(sim)


def test_a_full_pool_coarsens_and_keeps_its_mass():
    sim, wanted, finer = rested(4000)
    sim.close()
    small, count, coarser = rested(int(0.7 * wanted))
    assert count <= small.particles.capacity
    assert small.solver.adaptation.thickness < 1.0
    assert coarser.sum() == pytest.approx(finer.sum(), rel=1e-12)
    # Fine particles still lie at the surface.
    y, layer = small.particles.numpy("x")[:, 1], small.particles.numpy("layer")
    assert y[layer == 0].mean() > y[layer == 2].mean() + 0.1


def test_merges_double_masses_of_rounded_spacings_exactly():
    specs = [spec_of(d, 2.5) for d in (0.050797, 0.032, 0.040317, 0.1)]
    exact = [s.mass for s in with_exact_ratios(specs)]
    assert exact[2] == 2.0 * exact[1] and exact[0] == 2.0 * exact[2]
    assert exact[1] == specs[1].mass and exact[3] == specs[3].mass


def test_deep_water_of_halved_cubes_starts_at_rest_density():
    """Water 60 fine spacings deep, split from coarse cubes, starts below 1001 kg/m^3 everywhere.

    Regression: 100 rounds left some of the water too dense, which lifted it and raised its energy.
    """
    fine = 0.02
    specs = [LayerSpec(1000.0 * fine**3 * 2**k, 1000.0, 2.45) for k in range(3)]
    cells = np.array([5, 38, 5])
    size = cells * specs[2].spacing
    x, box = lattice(cells, specs[2].spacing), (size[0], size[1] + 0.3, size[2])
    adaptation = AdaptationParameters(band=20.0, every=10**9)
    sim = simulate(box, specs, x, 2, adaptation=adaptation, capacity=4 * len(x))
    assert sim.counts()[0] > 2 * len(x)
    assert sim.particles.numpy("density").max() < 1001.0
