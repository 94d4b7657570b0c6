"""Layers: sets of particles of equal mass and support radius.

In the classic method a layer also has its own gravity factor, viscosity and kernels (Gokdogan 2008,
ch. 3). Particles store a layer index; kernels look up the layer's numbers in tables.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import taichi as ti

from msph.device_table import DeviceTable, f32, i32

# Exponent (-) of the power mean of two supports; see pair_support().
PAIRING = 2.5
# Radius of a sphere of a particle's volume, in spacings: (3/(4 pi))^(1/3).
SPHERE_RADIUS = (3.0 / (4.0 * np.pi)) ** (1.0 / 3.0)
# Largest number of layers: masses of 1 : 2 reach 1 : 32768.
MAX_LAYERS = 16
# Columns of the table by layer.
ROWS = {
    "mass": f32,  # of a particle [kg]
    "volume": f32,  # at rest [m^3]
    "per_volume": f32,  # [1/m^3]
    "spacing": f32,  # [m]
    "support": f32,  # [m]
    "gravity_factor": f32,  # classic method (-)
    "viscosity": f32,  # classic method [Pa s]
    "wendland": i32,  # classic method: 1 for Wendland's kernel
    "per_support": f32,  # [1/m]
    "dims": ti.math.ivec3,  # cells of its grid along each axis
    "offset": i32,  # first cell of its grid
    "max_reach": f32,  # reach of its neighbour list [m]
    "own": f32,  # contribution of a particle to its own relative density (-)
    "own_bell": f32,  # the same with the bell kernel (-)
    "surface_share": f32,  # 1 - c at the surface of a cubic lattice (-)
    "surface_slope": f32,  # |sum V_j grad W_ij| there [1/m]
    "wall_support": f32,  # support of the kernel in the bodies' integrals [m]
    "top": f32,  # depth of its band's top [m]
    "bottom": f32,  # depth of its band's bottom [m]
    "coarser": i32,  # layer that two of its particles merge into, or -1
    "finer": i32,  # layer that its particles split into, or -1
}
# Columns of the table by pair of layers.
PAIRS = {
    "per_h": f32,  # 1 over the symmetric support [1/m]
    "list_reach": f32,  # of the neighbour list [m]
    "scale": f32,  # factor from the kernel's shape to V_j W_ij (-)
    "bell_scale": f32,  # the same for the bell kernel (-)
    "stress_share": f32,  # first particle's share of a pair's stress (-)
}


@dataclass(frozen=True)
class LayerSpec:
    """One layer.

    mass [kg], rest density [kg/m^3]; smoothing is h/d, support radius over particle spacing (-).
    For the classic method only: gravity_factor (-), viscosity [Pa s], wendland (True: Wendland C2
    instead of Mueller's kernels).
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
        """Particle spacing d = (m/rho0)^(1/3) [m], the edge of a particle's cube at rest."""
        return self.volume ** (1.0 / 3.0)

    @property
    def support(self) -> float:
        """Support radius h [m] at which the kernels vanish."""
        return self.smoothing * self.spacing


def pair_support(h_i, h_j):
    """Returns the symmetric support [m] of two particles, a power mean of their supports.

    With the arithmetic mean, random mixtures of two sizes at c = 1 fill up to 2.5 % less space than
    both sizes apart, and layers mix under weight. With the exponent 2.5 they fill 0.1 to 0.7 %
    more, and layers stay separate (docs/method.md, "Layers").
    """
    return (0.5 * (h_i**PAIRING + h_j**PAIRING)) ** (1.0 / PAIRING)


def stress_share(supports: np.ndarray) -> np.ndarray:
    """Returns the first layer's share (-), (n, n), of the stress of pairs of layers with supports
    (n,) [m]; the second layer has the remainder of 1.

    A pair's stress acts along the line between its ends. Halves assigned to both ends exceed its
    mean by 1/12 (r.grad)^2. These errors sum to zero among equal particles, but not between layers,
    where the second moment of pairs varies as h^2. This share cancels the error to second order for
    every kernel (docs/method.md, "Pressure").
    """
    own, other = supports[:, None], supports
    return 0.5 - (other**2 - own**2) / (12.0 * pair_support(own, other) ** 2)


class Layers:
    """Tables by layer and by pair of layers, refilled for each scene.

    Each name in ROWS is a Taichi field of shape (MAX_LAYERS,), each name in PAIRS a field of shape
    (MAX_LAYERS, MAX_LAYERS). `count` and `specs` are host values; kernels must not read them.
    """

    def __init__(self):
        self.specs: list[LayerSpec] = []
        self.count = 0
        self._rows = DeviceTable((MAX_LAYERS,), **ROWS)
        self._pairs = DeviceTable((MAX_LAYERS, MAX_LAYERS), **PAIRS)
        for table in (self._rows, self._pairs):
            self.__dict__.update({name: getattr(table, name) for name in table.fields})

    def load(self, specs: list[LayerSpec], rows: dict, pairs: dict) -> None:
        """Fills the tables; rows, pairs: further columns by name (0 if missing)."""
        supports = np.array([s.support for s in specs])
        names = ("mass", "volume", "spacing", "support", "gravity_factor", "viscosity", "wendland")
        own = {name: [getattr(s, name) for s in specs] for name in names}
        per_h = 1.0 / pair_support(supports[:, None], supports)
        self.specs, self.count = specs, len(specs)
        self._rows.fill(**own, **rows)
        self._pairs.fill(per_h=per_h, **pairs)

    def __getattr__(self, name: str) -> Any:
        # For type checkers, which cannot know the tables' columns.
        raise AttributeError(f"layers have no {name}")

    @property
    def rest_density(self) -> float:
        """Rest density rho0 [kg/m^3], equal in all layers."""
        return self.specs[0].density

    @property
    def finest(self) -> LayerSpec:
        return self.specs[self.finest_index]

    @property
    def finest_index(self) -> int:
        """Index of the layer with the smallest mass."""
        return min(range(len(self.specs)), key=lambda k: self.specs[k].mass)
