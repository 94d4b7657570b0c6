"""The methods a scene can choose, and what the rest of the fluid asks of each."""

from typing import Protocol

from msph.fluid.classic import Classic, ClassicTerms
from msph.fluid.forcing import Forcing
from msph.fluid.neighbours import NeighbourList
from msph.fluid.particles import Attribute
from msph.fluid.projection import Projection, ProjectionTerms

Terms = ClassicTerms | ProjectionTerms

SOLVERS = {ClassicTerms: Classic, ProjectionTerms: Projection}


class Solver(Protocol):
    """Advances the particles; its terms hold the rest density [kg/m^3] as `density`.

    internal_impulse [N s] is what pair forces have given in sum since the reset.
    """

    neighbours: NeighbourList

    @staticmethod
    def attributes(terms, bodies: bool = False) -> tuple[Attribute, ...]: ...

    def longest_step(self) -> float: ...

    def step(self, dt: float, forcing: Forcing) -> None: ...

    def reset(self) -> None: ...

    def arrange(self) -> None: ...
