"""The measurer: writes ledger, probes and a summary of a show to a folder."""

import sys
from pathlib import Path
from typing import Any

from tqdm import tqdm

from msph.measure import entry, summary
from msph.measure.probes import Snapshot, build_probes
from msph.measure.survey import COLUMNS, Survey, survey
from msph.measure.table import Table
from msph.scene.schema import Scene
from msph.stage.controls import Controls
from msph.stage.show import Show

LEDGER, PROBES, SUMMARY, SCENE = "ledger.csv", "probes.csv", "summary.json", "scene.toml"


class Measurer:
    """Watches the scene's whole duration, a row of each table per frame and one of its start.

    name is what the scene was asked for by, arch where kernels run. What it writes: ledger.csv,
    the entries and, from time to time, the surveys; probes.csv; and by conclude() summary.json.
    """

    def __init__(self, folder: Path, scene: Scene, name: str, arch: str, bar: bool = True):
        self.folder, self.scene = folder, scene
        self.origin = summary.origin(scene, name, arch)
        every, gap = scene.measure.every, scene.measure.survey
        self.frames = max(1, round(scene.duration / every))
        # Frames between surveys, 0: none.
        self.gap = max(1, round(gap / every)) if gap > 0.0 else 0
        self.done = 0
        self.probes = build_probes(scene)
        self.surveys: list[Survey] = []
        self.show: Any = None  # while nothing was shown
        heads = entry.columns() + (COLUMNS if self.gap else [])
        self.ledger = Table(folder / LEDGER, heads)
        heads = ["time [s]", *(f"{p.name} [{p.unit}]" for p in self.probes)]
        self.readings = Table(folder / PROBES, heads)
        self.bar = tqdm(
            total=self.frames, unit="frame", disable=not bar, file=sys.stderr, dynamic_ncols=True
        )

    def wants_more(self, show: Show) -> bool:
        return self.done < self.frames

    def controls(self, show: Show) -> Controls:
        if self.show is None:
            self.show, self.started = show, show.simulation.counts()
            show.ledger.record(show.gravity())
            self._write(show)
        return Controls()

    def see(self, show: Show) -> None:
        self.done += 1
        self._write(show)
        self.bar.update()

    def _write(self, show: Show) -> None:
        """A row of each table, from the ledger's last entry and the water as it is."""
        last = show.ledger.entries[-1]
        due = self.gap and (self.done % self.gap == 0 or self.done == self.frames)
        water = Snapshot.of(show.simulation) if due or self.probes else None
        row = last.row()
        if water and due:
            self.surveys.append(survey(last.time, show.volume(), water))
            row += self.surveys[-1].row()
        elif self.gap:
            row += [float("nan")] * len(COLUMNS)
        self.ledger.write(row)
        if water:
            readings = [probe.read(water) for probe in self.probes]
            self.readings.write([last.time, *readings])
        else:
            self.readings.write([last.time])

    def close(self) -> None:
        self.bar.close()

    def conclude(self, failure: str | None = None) -> list[Path]:
        """Writes the summary, with the reason why the run ended early if it did; returns the files
        that there are now."""
        self.close()
        result = {
            **self.origin,
            "complete": failure is None,
            "failure": failure,
            "frames": self.done,
        }
        if self.show is not None:
            frame_s = self.scene.measure.every
            laid = summary.water_laid(self.scene, self.show.simulation, self.started)
            error = laid.pop("mass_laid_error")
            result |= laid
            result |= summary.progress(self.show.simulation, self.started, frame_s)
            result |= summary.speed(self.show.timings, frame_s)
            found = summary.errors(self.show.ledger, self.surveys)
            result["errors"] = {"mass_laid_error": error, **found}
        summary.write(self.folder / SUMMARY, result)
        return [self.folder / name for name in (LEDGER, PROBES, SUMMARY, SCENE)]
