"""The parts of a projection solver that its forces and solves share."""

from dataclasses import dataclass

from msph.fluid.boundary.boundary import Boundary
from msph.fluid.boundary.contact import Contact
from msph.fluid.constants import Constants
from msph.fluid.impulse_ledger import ImpulseLedger
from msph.fluid.particles.layers import Layers
from msph.fluid.particles.neighbour_list import NeighbourList
from msph.fluid.particles.particles import Particles
from msph.fluid.projection.density import Density
from msph.fluid.projection.pressure_operator import PressureOperator


@dataclass(frozen=True, eq=False)
class Discretisation:
    """The particles, their neighbours, and the sums and operators over them."""

    constants: Constants
    boundary: Boundary
    contact: Contact
    layers: Layers
    particles: Particles
    neighbours: NeighbourList
    density: Density
    operator: PressureOperator
    impulses: ImpulseLedger
