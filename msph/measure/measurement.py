"""Measurement: writes ledger, probes, checkpoints and a summary of a run to a folder."""

import time
from pathlib import Path
from typing import Any

import numpy as np

from msph.measure import account, body_table, past, summary
from msph.measure.body_table import BodyTable
from msph.measure.entry import Entry
from msph.measure.probes import build_probes
from msph.measure.survey import Survey, survey, surveys_of
from msph.measure.table import ROUNDING, Table
from msph.own_files import replacing, write_json, written
from msph.scene.bodies import names
from msph.scene.schema import Scene
from msph.stage.controls import Controls
from msph.stage.progress import Progress
from msph.stage.row import Row
from msph.stage.show import Show

LEDGER, PROBES, SUMMARY, SCENE = "ledger.csv", "probes.csv", "summary.json", "scene.toml"
BODIES, CHECKPOINT = "bodies.csv", "checkpoint.npz"
FILES = (LEDGER, PROBES, BODIES, SUMMARY, SCENE, CHECKPOINT)
# Wall-clock time between checkpoints [s]; writing a checkpoint takes milliseconds.
CHECKPOINT_GAP = 10.0


class Measurement:
    """Runs the scene's whole duration and writes a row per table for the start and each frame.

    name: of the scene on the command line; since [s]: time of the checkpoint to continue from, if
    any; rows are then appended. Files: ledger.csv (entries, and surveys at longer intervals),
    probes.csv, bodies.csv if there are bodies, checkpoint.npz; conclude() writes summary.json.
    """

    def __init__(
        self,
        folder: Path,
        scene: Scene,
        name: str,
        arch: str,
        bar: bool = True,
        since: float | None = None,
    ):
        self.folder, self.scene, self.since = folder, scene, since
        self.origin = summary.origin(scene, name, arch)
        every, gap = scene.measure.every, scene.measure.survey
        self.frames = max(1, round(scene.duration / every))
        # Frames between surveys, 0 for no surveys.
        self.gap = max(1, round(gap / every)) if gap > 0.0 else 0
        self.done = round((since or 0.0) / every)
        if self.done >= self.frames:
            raise past.CheckpointError.beyond(since or 0.0, scene.duration)
        self.probes = build_probes(scene)
        self.surveys: list[Survey] = []
        self.before: Entry | None = None
        self.saved = time.monotonic()
        self.show: Any = None  # None before the first frame
        self.good: dict[str, Any] = {}  # state after the last complete frame
        self.result: dict[str, Any] = {}
        heads = Entry.columns() + (Survey.columns() if self.gap else [])
        self.ledger = Table(folder / LEDGER, heads, since)
        heads = ["time [s]", *(head for p in self.probes for head in p.heads)]
        self.readings = Table(folder / PROBES, heads, since)
        self.has_bodies = bool(names(scene))
        if self.has_bodies:
            self.motions = Table(folder / BODIES, body_table.columns(scene), since)
        if len(self.readings.kept):
            last = self.readings.kept[-1][1:].tolist()
            for probe in self.probes:
                probe.resume([last.pop(0) for _ in probe.heads])
        self.progress = Progress(self.frames, bar, self.done)

    def wants_more(self, row: Row) -> bool:
        return self.done < self.frames

    def controls(self, row: Row) -> Controls:
        if self.show is None:
            self._begin(row.lead)
        return Controls()

    def observe(self, row: Row) -> None:
        show = row.lead
        self.done += 1
        entries = show.ledger.entries
        entries[-1] = past.continued(entries[-1], self.before)
        self._write(show)
        self.good = show.simulation.state()
        self.progress.update()
        if time.monotonic() - self.saved > CHECKPOINT_GAP:
            self._save()

    def _begin(self, show: Show) -> None:
        """Records the initial state, or reads the earlier entries of a resumed run."""
        self.progress.start()
        self.show, self.started = show, show.simulation.counts()
        self.first_step = show.simulation.steps
        self.bodies = BodyTable(show.simulation)
        rows, first = self.ledger.kept, len(Entry.columns())
        earlier = [Entry.of(row) for row in rows]
        if self.gap and earlier:
            mass = np.array([e.mass for e in earlier])
            self.surveys = surveys_of(rows[:, first:], mass, self.scene.density)
        self.before = earlier[-1] if earlier else None
        goes_on = earlier and abs(show.simulation.reached - earlier[-1].time) < ROUNDING
        # A frame has the gravity of its start; the work of a tilt counts in the next frame.
        x, y, z = earlier[-1].gravity.tolist() if goes_on else show.gravity()
        now = past.continued(show.ledger.record((x, y, z)), self.before)
        show.ledger.entries[:] = earlier if goes_on else [*earlier, now]
        if not goes_on:
            self._write(show)

    def _write(self, show: Show) -> None:
        """Writes a row of each table from the ledger's last entry and the current state."""
        last = show.ledger.entries[-1]
        due = self.gap and (self.done % self.gap == 0 or self.done == self.frames)
        water = show.snapshot(self.probes) if due or self.probes else None
        row = last.row()
        if water and due:
            volume = show.volume()
            self.surveys.append(survey(volume, water, show.display.surface.shortfall()))
            row += self.surveys[-1].row()
        elif self.gap:
            row += [float("nan")] * len(Survey.columns())
        self.ledger.write(row)
        if water:
            self.readings.write([last.time, *(n for p in self.probes for n in p.read(water))])
        else:
            self.readings.write([last.time])
        if self.has_bodies:
            self.motions.write(self.bodies.row(last.time))

    def _save(self) -> None:
        """Writes the checkpoint, completely or not at all."""
        with replacing(self.folder / CHECKPOINT) as file:
            np.savez_compressed(file, **self.good)
        self.saved = time.monotonic()

    def close(self) -> None:
        self.progress.close()

    def conclude(self, failure: str | None = None) -> list[Path]:
        """Writes the summary, with the reason of a failure if any; returns the existing files."""
        self.close()
        result = {
            **self.origin,
            "complete": failure is None,
            "failure": failure,
            "resumed_at_s": self.since,
            "frames": self.done,
        }
        if self.show is not None:
            show, frame_s = self.show, self.scene.measure.every
            result |= summary.water_mass(self.scene, show.simulation)
            error = result.pop("mass_laid_error")
            result |= summary.progress(show.simulation, self.started, frame_s, self.first_step)
            result |= summary.speed(show.timings, frame_s)
            result["errors"] = {
                "mass_laid_error": error,
                **summary.errors(show.ledger, self.surveys),
            }
            result |= summary.assessment(self.scene, show.ledger, self.surveys, result["errors"])
            if self.has_bodies and self.bodies.times:
                result["forces"] = self._forces()
            if self.good:
                self._save()
        self.result = result
        write_json(self.folder / SUMMARY, result)
        return [self.folder / name for name in FILES if written(self.folder / name)]

    def _forces(self) -> dict[str, Any]:
        """Returns the mean force [N] and torque [N m] on each body at the end of the run, and the
        averaging time [s]."""
        found, seconds = self.bodies.last_forces()
        rows = zip(names(self.scene), found.tolist(), strict=True)
        forces = {name: {"force_N": row[:3], "torque_N_m": row[3:]} for name, row in rows}
        return {"mean_over_s": seconds, **forces}

    def add(self, key: str, value: Any) -> None:
        """Adds a key to the summary file."""
        self.result[key] = value
        write_json(self.folder / SUMMARY, self.result)

    def account(self) -> str:
        """Returns a text with the errors of the run. Call after conclude()."""
        lines = account.account({**self.result["resolution"], **self.result["errors"]})
        text = account.text(lines, self.result["cautions"], self.result)
        return text + body_table.text(self.result.get("forces", {}))
