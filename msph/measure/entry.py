"""One line of the ledger: what is known of the water at one time, each quantity with its unit."""

from dataclasses import dataclass, fields
from typing import Annotated, get_args

import numpy as np


@dataclass(frozen=True)
class Entry:
    """The water at one time; vectors are (3,), moments of momentum about the box's origin.

    momentum_scale = sum m |v|, angular_scale = sum m |x - c| |v| with c the middle of the box: what
    a drift is measured against. potential = -M g . centre, zero at the origin. Impulses, works and
    merge_loss are sums since the start, as in msph.fluid.impulse_ledger; tilt_work is the work of
    turning the pool. Density errors: mean, 99th percentile and maximum over particles of
    rho/rho0 - 1 where positive, for below rest density lies every free surface; rho is summed with
    the method's kernel over the positions at `time`. outside counts particles beyond the box, the
    container, or inside an obstacle, by more than Boundary.leaked says.
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
    internal_impulse: Annotated[np.ndarray, "N s"]
    internal_angular_impulse: Annotated[np.ndarray, "N m s"]
    wall_impulse: Annotated[np.ndarray, "N s"]
    body_impulse: Annotated[np.ndarray, "N s"]
    wall_work: Annotated[float, "J"]
    user_impulse: Annotated[np.ndarray, "N s"]
    user_work: Annotated[float, "J"]
    tilt_work: Annotated[float, "J"]
    merge_loss: Annotated[float, "J"]
    density_error_mean: Annotated[float, "-"]
    density_error_p99: Annotated[float, "-"]
    density_error_max: Annotated[float, "-"]
    top_speed: Annotated[float, "m/s"]
    outside: Annotated[int, "-"]

    @property
    def work(self) -> float:
        """What walls, the user and tilting gave since the start [J]."""
        return self.wall_work + self.user_work + self.tilt_work

    @property
    def energy(self) -> float:
        """Kinetic and potential energy less the work done from outside [J]."""
        return self.kinetic + self.potential - self.work

    def row(self) -> list[float]:
        """The numbers of a table's row, in the order of columns()."""
        values = (getattr(self, f.name) for f in fields(self))
        return [x for value in values for x in np.atleast_1d(value).tolist()]


def columns() -> list[str]:
    """Heads of an entry's columns, "name [unit]", a vector's three as name_x, name_y, name_z."""
    heads = []
    for f in fields(Entry):
        kind, unit = get_args(f.type)
        parts = [f"{f.name}_{k}" for k in "xyz"] if kind is np.ndarray else [f.name]
        heads += [f"{part} [{unit}]" for part in parts]
    return heads
