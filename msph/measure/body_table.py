"""Motion of the bodies and forces on them, as a table and in the report of a run."""

import numpy as np

from msph.fluid.external_forces import rotation_vector
from msph.fluid.simulation import Simulation
from msph.scene.bodies import names
from msph.scene.schema import Scene

# Quantities of each body, with their units; vectors in the box's frame.
QUANTITIES = {
    "position": "m",
    "rotation": "rad",
    "velocity": "m/s",
    "spin": "rad/s",
    "force": "N",
    "torque": "N m",
}
# Time [s] at the end of a run over which the reported forces are means.
WINDOW = 1.0


def columns(scene: Scene) -> list[str]:
    """Returns the column heads of the table, the time first."""
    bodies = [name.replace(".", "_") for name in names(scene)]
    return ["time [s]"] + [
        f"{body}_{quantity}_{k} [{unit}]"
        for body in bodies
        for quantity, unit in QUANTITIES.items()
        for k in "xyz"
    ]


class BodyTable:
    """Rows of the bodies of a scene: centre, rotation vector since the start, velocity, spin, and
    the mean force and torque (about the centre) of the water since the last row."""

    def __init__(self, simulation: Simulation):
        simulation.record_forces()
        self.boundary, self.count = simulation.boundary, len(simulation.plan.bodies)
        self.times: list[float] = []
        self.sums: list[np.ndarray] = []  # impulses and angular impulses, (bodies, 6)

    def row(self, time: float) -> list[float]:
        """Returns the row of the present time [s], without bodies that the user added."""
        return [time, *self.numbers(time)[: self.count].ravel().tolist()]

    def numbers(self, time: float) -> np.ndarray:
        """Returns the QUANTITIES of all bodies at the present time [s], (bodies, 18). The first
        row, and bodies that the user added, have no forces."""
        boundary = self.boundary
        self.times.append(time)
        self.sums.append(np.hstack([boundary.impulse, boundary.twist])[: self.count])
        forces = np.full((boundary.count, 6), np.nan)
        forces[: self.count] = self._mean(len(self.times) - 2)
        poses = [
            [*boundary.centre_at_end(b), *rotation_vector(boundary.pose(b)[1])]
            for b in range(boundary.count)
        ]
        return np.hstack([np.reshape(poses, (-1, 6)), boundary.motions(), forces])

    def last_forces(self) -> tuple[np.ndarray, float]:
        """Returns the mean forces and torques (bodies, 6) on the bodies over the last WINDOW of the
        run, and the length of this time [s]."""
        first = int(np.searchsorted(self.times, self.times[-1] - WINDOW * (1.0 + 1e-6)))
        return self._mean(first), self.times[-1] - self.times[first]

    def _mean(self, first: int) -> np.ndarray:
        elapsed = self.times[-1] - self.times[max(first, 0)]
        if elapsed <= 0.0:
            return np.full_like(self.sums[-1], np.nan)
        return (self.sums[-1] - self.sums[first]) / elapsed


def text(forces: dict) -> str:
    """Returns the forces of a run's summary as lines of the report; "" without bodies."""
    if not forces:
        return ""
    lines = [f"\nforces of the water, mean of the last {forces['mean_over_s']:.3g} s (x, y, z)"]
    for name, found in forces.items():
        if name != "mean_over_s":
            force, torque = (
                ", ".join(f"{x:.4g}" for x in found[key]) for key in ("force_N", "torque_N_m")
            )
            lines.append(f"  {name}: {force} N; torque {torque} N m")
    return "\n".join(lines)
