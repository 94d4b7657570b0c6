"""Frame: a copy of the water, its bodies and the readings of its probes at one time."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from msph.fluid.simulation import Simulation
from msph.measure.body_table import QUANTITIES, BodyTable
from msph.measure.entry import Entry
from msph.measure.probes import Probe
from msph.measure.snapshot import Snapshot


class Particles(NamedTuple):
    """Arrays of length n: position x (n, 3) [m], velocity v (n, 3) [m/s], pressure [Pa], layer (-),
    and spacing [m], the edge of the cube of a particle's volume."""

    x: np.ndarray
    v: np.ndarray
    pressure: np.ndarray
    layer: np.ndarray
    spacing: np.ndarray


class BodyState(NamedTuple):
    """Arrays (3,): position of the centre [m], rotation vector since the start [rad], velocity
    [m/s], spin [rad/s]; force [N] and torque about the centre [N m] by the water, means over the
    last frame, NaN before the first."""

    position: np.ndarray
    rotation: np.ndarray
    velocity: np.ndarray
    spin: np.ndarray
    force: np.ndarray
    torque: np.ndarray


@dataclass(frozen=True, repr=False)
class Frame:
    """Copy of the water at one time [s]: particles, bodies and probes by name, and ledger (mass,
    momenta, energies; `help(frame.ledger)`). Readings of probes are also attributes, such as
    frame.height: numbers, arrays of vectors; NaN where dry."""

    time: float
    particles: Particles
    bodies: dict[str, BodyState]
    probes: dict[str, Any]
    ledger: Entry

    def __getattr__(self, name: str) -> Any:
        probes = self.__dict__.get("probes", {})
        if name not in probes:
            known = ", ".join(probes) or "none"
            raise AttributeError(f"no attribute or probe {name!r}; probes: {known}")
        return probes[name]


class Reader:
    """Reads frames of a simulation from a time on. names: of its bodies; snapshot: returns the
    water as probes read it; probes: to read."""

    def __init__(
        self, simulation: Simulation, names: list[str], snapshot: Callable[[list[Probe]], Snapshot]
    ):
        self.simulation, self.names, self.snapshot = simulation, names, snapshot
        self.probes = list[Probe]()
        self._table = BodyTable(simulation)

    def read(self, entry: Entry) -> Frame:
        """Returns the frame now, with the ledger's last entry; call once per frame, since forces on
        bodies are means since the last call."""
        sim, p = self.simulation, self.simulation.particles
        x, v, pressure, layer = (p.numpy(name) for name in ("x", "v", "pressure", "layer"))
        spacing = np.array([s.spacing for s in sim.layers.specs])[layer]
        rows = self._table.numbers(sim.time).reshape(-1, len(QUANTITIES), 3)
        bodies = dict(zip(self.names, (BodyState(*row) for row in rows), strict=True))
        water = self.snapshot(self.probes) if self.probes else None
        found = {probe.name: probe.read(water) for probe in self.probes if water}
        probes = {k: n[0] if len(n) == 1 else np.array(n) for k, n in found.items()}
        return Frame(sim.time, Particles(x, v, pressure, layer, spacing), bodies, probes, entry)
