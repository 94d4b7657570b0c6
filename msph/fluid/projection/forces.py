"""The forces of the projection method, in the order in which a step applies them.

A new force is a file with a class like these, and a line in FORCES; see docs/extending.md.
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
    """Changes velocities within a step. ATTRIBUTES: of its own on the particles; longest_step [s]:
    the longest step in which it is stable, infinity for any."""

    ATTRIBUTES: tuple[Attribute, ...]
    longest_step: float

    def __init__(self, shared: Discretisation): ...

    @staticmethod
    def wanted(parameters: ProjectionParameters) -> bool:
        """Whether the scene asks for it: else it costs nothing."""

    def tune(self, parameters: ProjectionParameters) -> None:
        """Takes over those parameters that are live (msph.parameter)."""

    def apply(self, dt: float, external: ExternalForces) -> None:
        """Velocities after dt [s] of this force."""


# XSPH before gravity: after it it would brake the fall that the floor's pressure has yet to stop.
FORCES: tuple[type[Force], ...] = (Xsph, BodyForce, ShearRelief, SurfaceTension, Viscosity)


def wanted(parameters: ProjectionParameters) -> tuple[type[Force], ...]:
    """The forces that a scene of these parameters has."""
    return tuple(force for force in FORCES if force.wanted(parameters))
