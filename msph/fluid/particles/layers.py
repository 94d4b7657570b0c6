"""Layers: particle sizes, from coarse to fine or in any order.

A layer is a set of particles with its own mass, support radius and, in the classic method, its
own gravity factor, viscosity and kernels (Gokdogan 2008, ch. 3). Particles hold a layer index;
everything that follows from it is looked up here.
"""

from dataclasses import dataclass

import numpy as np

from msph.constant_fields import constant_fields

# Exponent (-) of the power mean of two supports; see pair_support().
PAIRING = 2.5


@dataclass(frozen=True)
class LayerSpec:
    """One layer, in SI units.

    mass [kg], rest density [kg/m^3]; smoothing is h/d, support radius over particle spacing.
    gravity_factor (-) and viscosity [Pa s] serve the classic method alone, as does wendland
    (True: Wendland C2 in place of Mueller's kernels).
    """

    mass: float
    density: float
    smoothing: float
    gravity_factor: float = 1.0
    viscosity: float = 0.0
    wendland: bool = False

    @property
    def volume(self) -> float:
        """Rest volume of one particle [m^3]."""
        return self.mass / self.density

    @property
    def spacing(self) -> float:
        """Edge of the cube that one particle fills at rest, d = (m/rho0)^(1/3) [m]."""
        return self.volume ** (1.0 / 3.0)

    @property
    def support(self) -> float:
        """Support radius h [m] at which the kernels vanish."""
        return self.smoothing * self.spacing


def pair_support(h_i, h_j):
    """Symmetric support of two particles [m], a power mean of their own.

    With the arithmetic mean, particles of two sizes, mixed at random and held at c = 1, fill up to
    2.5 % less space than apart, and weight presses layers into each other. With the exponent 2.5
    they fill .1 to .7 % more, and layers stay apart (docs/method.md, "Layers").
    """
    return (0.5 * (h_i**PAIRING + h_j**PAIRING)) ** (1.0 / PAIRING)


def stress_share(supports: np.ndarray) -> np.ndarray:
    """Share (n, n) of the stress of a pair of layers that belongs to the first (-); the other has
    the rest of 1. supports (n,) [m].

    A pair's stress acts all along the line between its ends. Counted at the ends, it exceeds that
    by 1/12 (r.grad)^2 in any mean: nothing among equals, but not between layers, where the second
    moment of pairs varies as h^2. This share cancels it to second order, whatever the kernel
    (docs/method.md, "Pressure").
    """
    own, other = supports[:, None], supports
    return 0.5 - (other**2 - own**2) / (12.0 * pair_support(own, other) ** 2)


class Layers:
    """The layers of a scene as Taichi fields of shape (count,): mass [kg], volume [m^3],
    spacing [m], support [m], gravity_factor (-), viscosity [Pa s], wendland (0 or 1); and per_h
    (count, count), over the symmetric support of a pair [1/m]."""

    def __init__(self, specs: list[LayerSpec]):
        if not specs:
            raise ValueError("a fluid needs at least one layer")
        self.specs = specs
        self.count = len(specs)
        names = ("mass", "volume", "spacing", "support", "gravity_factor", "viscosity")
        supports = np.array([s.support for s in specs])
        self.mass, self.volume, self.spacing, self.support, *others = constant_fields(
            *(np.array([getattr(s, name) for s in specs]) for name in names),
            np.array([int(s.wendland) for s in specs]),
            1.0 / pair_support(supports[:, None], supports),
        )
        self.gravity_factor, self.viscosity, self.wendland, self.per_h = others

    @property
    def finest(self) -> LayerSpec:
        return min(self.specs, key=lambda s: s.mass)
