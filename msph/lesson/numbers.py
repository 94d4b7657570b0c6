"""Numbers of a simulation that expressions of lessons read: quantities, probes, amplitudes."""

from collections.abc import Callable
from typing import Any

import numpy as np

from msph.lesson import physics
from msph.lesson.quantities import QUANTITIES
from msph.measure.probes import build_probes
from msph.measure.snapshot import Snapshot
from msph.stage.show import Show

# Simulated time [s] between measurements of quantities that take milliseconds.
SURVEY_INTERVAL = 0.1
# Suffix of the names of the amplitudes of probes.
AMPLITUDE = "_amplitude"


class Numbers:
    """Quantities, probes and amplitudes of probes (gauge_amplitude) of a simulation as attributes;
    slow quantities and probes are measured once per SURVEY_INTERVAL. Those of a simulation in
    another process are of its last frame there, NaN until it has answered."""

    def __init__(self, show: Any):
        if not show.parallel:
            show.simulation.record_forces()  # as `lift` needs in gaps between bodies and walls
        self._show = show
        self._read: dict[str, tuple[float, Any]] = {}  # time of measurement [s], and value
        self._probes = {p.name: p for p in build_probes(show.scene) if len(p.heads) == 1}
        self._past: dict[str, list[tuple[float, float]]] = {name: [] for name in self._probes}

    def __getattr__(self, name: str) -> float:
        quantity, probe = QUANTITIES.get(name), self._probes.get(name)
        base = name.removesuffix(AMPLITUDE)
        has_amplitude = base != name and base in self._probes
        if quantity is None and probe is None and not has_amplitude:
            raise AttributeError(name)
        if self._show.parallel:
            if not (quantity and quantity.shown):
                return self._show.number(name)
        elif not self._show.ledger.entries:
            self._show.ledger.record(self._show.gravity())
        if probe:
            return self._cached(name, lambda _: probe.read(self._water())[0])
        if has_amplitude:
            return self._amplitude(base)
        assert quantity
        return self._cached(name, quantity.read) if quantity.slow else quantity.read(self._show)

    def _amplitude(self, name: str) -> float:
        """Returns the amplitude of a probe's readings since it was first asked for."""
        past, value = self._past[name], getattr(self, name)
        time = self._read[name][0]
        if not past or past[-1][0] != time:
            past.append((time, value))
        return physics.amplitude(*np.array(past).T)

    def _water(self) -> Snapshot:
        """Returns the water that the probes read."""
        return self._cached("", lambda show: show.snapshot([*self._probes.values()]))

    def _cached(self, name: str, read: Callable[[Show], Any]) -> Any:
        time = self._show.now.time
        known = self._read.get(name)
        if known is None or not 0.0 <= time - known[0] < SURVEY_INTERVAL:
            known = self._read[name] = time, read(self._show)
        return known[1]


def known_numbers(scene: Any) -> set[str]:
    """Returns the names of a scene's quantities and of its probes with one reading, and of their
    amplitudes."""
    probes = {p.name for p in build_probes(scene) if len(p.heads) == 1}
    return set(QUANTITIES) | probes | {name + AMPLITUDE for name in probes}
