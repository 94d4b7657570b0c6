"""The methods a scene can choose, and what the rest of the fluid asks of each."""

from typing import Any, Protocol

from msph.fluid.classic import Classic, ClassicTerms
from msph.fluid.forcing import Forcing
from msph.fluid.neighbours import NeighbourList
from msph.fluid.particles import Attribute
from msph.fluid.projection import Projection
from msph.fluid.projection_terms import ProjectionTerms

Terms = ClassicTerms | ProjectionTerms

SOLVERS: dict[type, Any] = {ClassicTerms: Classic, ProjectionTerms: Projection}


class Solver(Protocol):
    """Advances the particles; its terms hold the rest density [kg/m^3] as `density`.

    Its accounts are fields of shape (), explained by Accounts. iterations: of the last step's
    pressure solve, 0 for a method that solves nothing.
    """

    terms: Any
    neighbours: NeighbourList
    iterations: int
    internal_impulse: Any
    internal_angular_impulse: Any
    wall_impulse: Any
    wall_work: Any
    user_impulse: Any
    user_work: Any
    merge_loss: Any

    @staticmethod
    def attributes(terms, bodies: bool = False) -> tuple[Attribute, ...]: ...

    def longest_step(self) -> float: ...

    def step(self, dt: float, forcing: Forcing) -> None: ...

    def reset(self) -> None: ...

    def arrange(self) -> None: ...
