"""Base class of the forces and solves of the projection method."""

import taichi as ti

from msph.fluid.part import Part
from msph.fluid.projection.density import Density
from msph.fluid.projection.pressure_operator import PressureOperator
from msph.fluid.projection.virial_pressure import VirialPressure


class Discretisation(Part):
    """Object that has the parts of a fluid, and the sums and operators over pairs of particles, as
    attributes."""

    density: Density
    pair_gradient: ti.MatrixField
    operator: PressureOperator
    virial: VirialPressure
