"""Layers: particle sizes, from coarse to fine or in any order.

A layer is a set of particles with its own mass, support radius and, in the classic method, its
own gravity factor, viscosity and kernels (Gokdogan 2008, ch. 3). Particles hold a layer index;
everything that follows from it is looked up here.
"""

from dataclasses import dataclass

import numpy as np

from msph.tables import tables


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


class Layers:
    """The layers of a scene as Taichi fields of shape (count,): mass [kg], volume [m^3],
    spacing [m], support [m], gravity_factor (-), viscosity [Pa s], wendland (0 or 1)."""

    def __init__(self, specs: list[LayerSpec]):
        if not specs:
            raise ValueError("a fluid needs at least one layer")
        self.specs = specs
        self.count = len(specs)
        self.mass, self.volume, self.spacing, self.support = tables(
            np.array([s.mass for s in specs]),
            np.array([s.volume for s in specs]),
            np.array([s.spacing for s in specs]),
            np.array([s.support for s in specs]),
        )
        self.gravity_factor, self.viscosity, self.wendland = tables(
            np.array([s.gravity_factor for s in specs]),
            np.array([s.viscosity for s in specs]),
            np.array([int(s.wendland) for s in specs]),
        )

    @property
    def finest(self) -> LayerSpec:
        return min(self.specs, key=lambda s: s.mass)
