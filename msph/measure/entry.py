"""An entry of the ledger: quantities of the water at one time, with their units."""

from dataclasses import dataclass, fields
from typing import Annotated, Any, TypeVar, get_args, get_origin

import numpy as np

R = TypeVar("R", bound="Record")

# Parts of the mechanical energy, and of the external work since the start.
ENERGIES = (
    *("kinetic", "potential", "spilt_energy", "outflow_energy"),
    *("floating_kinetic", "floating_potential"),
)
WORKS = ("wall_work", "user_work", "inertia_work", "tilt_work", "inflow_work")

# Marks sums since the start, which a resumed run restarts at zero.
SUM = "sum since the start"


class Record:
    """A dataclass that is part of a table's row. Fields annotated with a unit are columns, a vector
    three of them."""

    @classmethod
    def annotated(cls) -> dict[str, tuple[Any, ...]]:
        """Returns type, unit and marks of each field that is a column, by name."""
        kinds = {f.name: f.type for f in fields(cls)}  # type: ignore[arg-type]
        return {name: get_args(k) for name, k in kinds.items() if get_origin(k) is Annotated}

    @classmethod
    def columns(cls) -> list[str]:
        """Returns the column heads "name [unit]"; a vector has name_x, name_y, name_z."""
        heads = []
        for name, (kind, unit, *_) in cls.annotated().items():
            parts = [f"{name}_{k}" for k in "xyz"] if kind is np.ndarray else [name]
            heads += [f"{part} [{unit}]" for part in parts]
        return heads

    def row(self) -> list[float]:
        """Returns the numbers of a table row, in the order of columns()."""
        values = (getattr(self, name) for name in self.annotated())
        return [x for value in values for x in np.atleast_1d(value).tolist()]

    @classmethod
    def of(cls: type[R], row: np.ndarray, *others: Any) -> R:
        """Returns the record whose row() is at the beginning of `row`; others: fields without
        columns."""
        values, cells = [], iter(row)
        for kind, *_ in cls.annotated().values():
            vector = kind is np.ndarray
            values.append(np.array([next(cells) for _ in "xyz"]) if vector else kind(next(cells)))
        return cls(*values, *others)


@dataclass(frozen=True)
class Entry(Record):
    """Quantities of the water at one time; vectors are (3,), angular momenta about the origin.

    momentum_scale = sum m |v| and angular_scale = sum m |x - c| |v|, with c the box's centre, are
    the references of drifts. potential = -M g . centre, zero at the origin. Most of the SUMs are
    those of msph.fluid.impulse_ledger; tilt_work is the
    work of turning gravity in the frame of the box, inertia_work includes floating bodies. Solver
    residuals are the mean, 99th percentile and maximum over particles of max(rho/rho0 - 1, 0), as
    densities at free surfaces are below rest; rho is the solver's own density, its correction
    included, at the positions at `time`. outside: number of particles outside the box or the
    container or in a body, by Contact.leaked. spilt: mass that left an open box since the start,
    not part of mass; spilt_momentum, spilt_energy (kinetic and potential): of this water when it
    left. outflow_*: the same for water that left through outflows. inflow_*: of the water that
    inflows added, and by prescribed velocities. body_impulse: of all bodies on the water, removed
    bodies included. floating_*: of all floating bodies, which are not part of the other totals.
    """

    time: Annotated[float, "s"]
    mass: Annotated[float, "kg"]
    centre: Annotated[np.ndarray, "m"]
    momentum: Annotated[np.ndarray, "kg m/s"]
    momentum_scale: Annotated[float, "kg m/s"]
    angular_momentum: Annotated[np.ndarray, "kg m^2/s"]
    angular_scale: Annotated[float, "kg m^2/s"]
    kinetic: Annotated[float, "J"]
    potential: Annotated[float, "J"]
    gravity: Annotated[np.ndarray, "m/s^2"]
    internal_impulse: Annotated[np.ndarray, "N s", SUM]
    internal_angular_impulse: Annotated[np.ndarray, "N m s", SUM]
    wall_impulse: Annotated[np.ndarray, "N s", SUM]
    body_impulse: Annotated[np.ndarray, "N s", SUM]
    wall_work: Annotated[float, "J", SUM]
    user_impulse: Annotated[np.ndarray, "N s", SUM]
    user_work: Annotated[float, "J", SUM]
    inertia_impulse: Annotated[np.ndarray, "N s", SUM]
    inertia_work: Annotated[float, "J", SUM]
    tilt_work: Annotated[float, "J", SUM]
    added_mass: Annotated[float, "kg", SUM]
    merge_loss: Annotated[float, "J", SUM]
    floating_momentum: Annotated[np.ndarray, "kg m/s"]
    floating_angular_momentum: Annotated[np.ndarray, "kg m^2/s"]
    floating_kinetic: Annotated[float, "J"]
    floating_potential: Annotated[float, "J"]
    solver_residual_mean: Annotated[float, "-"]
    solver_residual_p99: Annotated[float, "-"]
    solver_residual_max: Annotated[float, "-"]
    top_speed: Annotated[float, "m/s"]
    outside: Annotated[int, "-"]
    spilt: Annotated[float, "kg"]
    spilt_momentum: Annotated[np.ndarray, "kg m/s", SUM]
    spilt_energy: Annotated[float, "J", SUM]
    inflow_mass: Annotated[float, "kg", SUM]
    inflow_impulse: Annotated[np.ndarray, "N s", SUM]
    inflow_work: Annotated[float, "J", SUM]
    outflow_mass: Annotated[float, "kg", SUM]
    outflow_momentum: Annotated[np.ndarray, "kg m/s", SUM]
    outflow_energy: Annotated[float, "J", SUM]

    @property
    def work(self) -> float:
        """External work since the start [J]."""
        return sum(getattr(self, name) for name in WORKS)

    @property
    def mechanical(self) -> float:
        """Kinetic and potential energy [J] of the water, with the water that left, and of floating
        bodies."""
        return sum(getattr(self, name) for name in ENERGIES)

    @property
    def energy(self) -> float:
        """Mechanical energy less external work [J]."""
        return self.mechanical - self.work


def energy_less_work(ledger: dict[str, np.ndarray]) -> np.ndarray:
    """Returns Entry.energy [J] of each row of a ledger's table (table.read); constant without
    dissipation."""
    energies, works = ([ledger[f"{name}_J"] for name in names] for names in (ENERGIES, WORKS))
    return np.sum(energies, axis=0) - np.sum(works, axis=0)
