"""Simulation methods that a scene can choose (interface of a solver: docs/extending.md)."""

from typing import Any

from msph.fluid.classic import Classic
from msph.fluid.classic_parameters import ClassicParameters
from msph.fluid.particles.particles import Attribute
from msph.fluid.projection.parameters import ProjectionParameters
from msph.fluid.projection.solver import Projection

Parameters = ClassicParameters | ProjectionParameters


# Solver classes by name.
METHODS: dict[str, Any] = {solver.NAME: solver for solver in (Classic, Projection)}


def methods_with(ability: str) -> str:
    """Returns the names of the methods with an ability such as "ADAPTS", joined by "or"."""
    return " or ".join(name for name, solver in METHODS.items() if getattr(solver, ability))


def all_attributes() -> tuple[Attribute, ...]:
    """Returns the attributes of all methods beyond the core; a world allocates all of them."""
    found = {a.name: a for solver in METHODS.values() for a in solver.attributes(None, True)}
    return tuple(found.values())


def solver_of(parameters: Parameters) -> Any:
    """Returns the solver class that takes these parameters."""
    return next(s for s in METHODS.values() if isinstance(parameters, s.PARAMETERS))
