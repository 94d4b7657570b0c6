"""Forces of the projection method, in the order in which a step applies them.

A new force is a class with the methods of Force and an entry in FORCES (docs/extending.md).
"""

from typing import Protocol

from msph.fluid.external_forces import ExternalForces
from msph.fluid.particles.particles import Attribute
from msph.fluid.projection.body_force import BodyForce
from msph.fluid.projection.discretisation import Discretisation
from msph.fluid.projection.parameters import ProjectionParameters
from msph.fluid.projection.shear_relief import ShearRelief
from msph.fluid.projection.surface_tension import SurfaceTension
from msph.fluid.projection.viscosity import Viscosity
from msph.fluid.projection.xsph import Xsph


class Force(Protocol):
    """Interface of a force, which changes velocities within a step.

    ATTRIBUTES: the force's own particle attributes. longest_step [s]: the longest stable step,
    infinity if every step is stable.
    """

    ATTRIBUTES: tuple[Attribute, ...]
    longest_step: float

    def __init__(self, shared: Discretisation): ...

    @staticmethod
    def enabled(parameters: ProjectionParameters) -> bool:
        """Returns whether the scene uses the force; if not, the force costs nothing."""

    def tune(self, parameters: ProjectionParameters) -> None:
        """Updates the live parameters (msph.parameter)."""

    def apply(self, dt: float, external: ExternalForces) -> None:
        """Advances the velocities by dt [s] under this force."""


# XSPH precedes gravity: after it, XSPH would brake water at rest on a floor, whose fall the
# pressure has not stopped yet.
FORCES: tuple[type[Force], ...] = (Xsph, BodyForce, ShearRelief, SurfaceTension, Viscosity)
