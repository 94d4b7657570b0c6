"""The methods that a scene can choose, and what the rest of the fluid asks of each."""

from typing import Any, Protocol

from msph.fluid.classic import Classic, ClassicParameters
from msph.fluid.external_forces import ExternalForces
from msph.fluid.impulse_ledger import ImpulseLedger
from msph.fluid.particles.layers import LayerSpec
from msph.fluid.particles.neighbour_list import NeighbourList
from msph.fluid.particles.particles import Attribute
from msph.fluid.projection.parameters import ProjectionParameters
from msph.fluid.projection.solver import Projection
from msph.fluid.stages import Stage

Parameters = ClassicParameters | ProjectionParameters


class Solver(Protocol):
    """Advances the particles.

    NAME: what scenes call it, and the table of their files that holds its parameters, of the class
    PARAMETERS. ADAPTS: whether its particles may split and merge; HAS_BODIES: whether bodies and
    containers may hold its water; LAYER_OPTIONS: the options of a layer that it heeds beyond its
    size; SMOOTHING: support over spacing where a scene gives none (-); LIST_MARGIN: margin of the
    neighbour list, in supports; PER_ENTRY: numbers stored beside each of its entries; MIRRORS:
    whether walls are mirrors. One object works for every scene in turn, after load(). iterations:
    of the last step's pressure solve, 0 for a method that solves nothing.
    """

    NAME: str
    PARAMETERS: type
    ADAPTS: bool
    HAS_BODIES: bool
    LAYER_OPTIONS: tuple[str, ...]
    SMOOTHING: float
    LIST_MARGIN: float
    PER_ENTRY: int
    MIRRORS: bool

    parameters: Any
    impulses: ImpulseLedger
    neighbours: NeighbourList
    iterations: int

    @staticmethod
    def all_attributes() -> tuple[Attribute, ...]: ...

    @staticmethod
    def attributes(parameters, adaptive: bool) -> tuple[Attribute, ...]: ...

    @staticmethod
    def constants_of(parameters, adaptation, specs: list[LayerSpec]) -> dict[str, Any]: ...

    @staticmethod
    def tables_of(adaptation, specs: list[LayerSpec]) -> tuple[dict, dict]: ...

    @staticmethod
    def list_form(parameters) -> str: ...

    def load(self, parameters, adaptation) -> None: ...

    def longest_step(self, safety: float = 1.0) -> float: ...

    def step(self, dt: float, external: ExternalForces, stage: Stage) -> None: ...

    def measure_density(self, stage: Stage = ...) -> None: ...

    def reset(self) -> None: ...

    def arrange(self) -> None: ...

    def state(self) -> dict[str, float]: ...

    def restore(self, state: dict[str, float]) -> None: ...


# By the names that scenes call them.
METHODS: dict[str, Any] = {solver.NAME: solver for solver in (Classic, Projection)}


def methods_with(ability: str) -> str:
    """Names of the methods that have an ability, such as "ADAPTS", in words."""
    return " or ".join(name for name, solver in METHODS.items() if getattr(solver, ability))


def all_attributes() -> tuple[Attribute, ...]:
    """Attributes that any scene may use, beyond the core: a world has fields for all of them."""
    found = {a.name: a for solver in METHODS.values() for a in solver.all_attributes()}
    return tuple(found.values())


def solver_of(parameters: Parameters) -> Any:
    """The class of the solver that has such parameters."""
    return next(s for s in METHODS.values() if isinstance(parameters, s.PARAMETERS))
