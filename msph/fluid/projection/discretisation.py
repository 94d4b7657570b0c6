"""Components that the forces and solves of the projection method share."""

from dataclasses import dataclass

from msph.fluid.parts import Parts
from msph.fluid.projection.density import Density
from msph.fluid.projection.pressure_operator import PressureOperator


@dataclass(frozen=True, eq=False)
class Discretisation(Parts):
    """The components of every method, and the sums and operators over pairs of particles."""

    density: Density
    operator: PressureOperator
