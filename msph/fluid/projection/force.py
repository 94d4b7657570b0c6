"""Base class of the forces of the projection method."""

import math

from msph.fluid.external_forces import ExternalForces
from msph.fluid.particles.particles import Attribute
from msph.fluid.projection.discretisation import Discretisation
from msph.fluid.projection.parameters import ProjectionParameters


class Force(Discretisation):
    """Base of a force, which changes velocities within a step.

    ATTRIBUTES: the force's own particle attributes. longest_step [s]: the longest stable step, set
    by the parameter LIMITED_BY.
    """

    ATTRIBUTES: tuple[Attribute, ...] = ()
    LIMITED_BY = ""
    longest_step = math.inf

    @staticmethod
    def enabled(parameters: ProjectionParameters) -> bool:
        """Returns True if the scene uses the force; otherwise the force costs no time."""
        return True

    def tune(self, parameters: ProjectionParameters) -> None:
        """Updates the live parameters (msph.parameter)."""

    def apply(self, dt: float, external: ExternalForces) -> None:
        """Advances the velocities by dt [s] under this force."""
        raise NotImplementedError
