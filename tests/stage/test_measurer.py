"""Tests of a measurement: a run resumed from its checkpoint agrees with an uninterrupted run."""

import json

import numpy as np
import pytest

from msph.measure.ledger import NotFiniteError
from msph.measure.measurement import Measurement
from msph.measure.past import CheckpointError, time_of
from msph.measure.table import read
from msph.measure.timings import Timings
from msph.stage.controls import Controls
from msph.stage.loop import run
from msph.stage.row import Row
from msph.stage.show import Show
from tests.scenes_kit import GAUGE, TEXT, load

EVERY, CUT, END = 0.02, 0.06, 0.12
SWAY = """
[sway]
angle = 20.0
period = 0.5
[measure]
every = 0.02
survey = 0.04
"""


def measured(show, folder, scene, seconds, since=None):
    scene = scene.model_copy(update={"duration": seconds})
    measurement = Measurement(folder, scene, "small", "cpu", bar=False, since=since)
    run(Row([show]), measurement)
    measurement.conclude()
    return json.loads((folder / "summary.json").read_text())


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Returns the folders and summaries of an uninterrupted run, and of a run that was stopped
    beyond its checkpoint and resumed."""
    whole, cut = tmp_path_factory.mktemp("whole"), tmp_path_factory.mktemp("cut")
    scene = load(whole, TEXT + SWAY + GAUGE)
    show = Show(scene, EVERY, timings=Timings())
    found = [measured(show, whole, scene, END)]
    show.reset()
    measured(show, cut, scene, CUT)
    checkpoint = cut / "first.npz"
    (cut / "checkpoint.npz").rename(checkpoint)
    # An interrupted run has advanced beyond its checkpoint.
    show.frame(Controls())
    with open(cut / "ledger.csv", "a") as file:
        file.write(file_row(cut, 0.08))
    show.resume(checkpoint)
    found.append(measured(show, cut, scene, END, since=time_of(checkpoint)))
    return (whole, cut), found


def file_row(folder, time):
    """Returns a row of a ledger that the resumed run must remove."""
    columns = len((folder / "ledger.csv").read_text().splitlines()[0].split(","))
    return ",".join([f"{time}", *["9e9"] * (columns - 1)]) + "\n"


def test_tables_continue_at_the_checkpoint(runs):
    """Also sums since the start, which the fluid restarts at zero."""
    (whole, cut), _ = runs
    for name in ("ledger.csv", "probes.csv"):
        ours, theirs = read(cut / name), read(whole / name)
        assert list(ours) == list(theirs)
        assert ours["time_s"] == pytest.approx(theirs["time_s"])
        assert ours["time_s"] == pytest.approx(np.arange(7) * EVERY)
    ours, theirs = read(cut / "ledger.csv"), read(whole / "ledger.csv")
    for column in ("wall_impulse_y_N_s", "tilt_work_J", "kinetic_J", "centre_y_m", "volume_m3"):
        known = np.isfinite(theirs[column])
        scale = np.abs(theirs[column][known]).max()
        # The stopped run ended with a survey, so its table may have more values.
        assert np.isfinite(ours[column][known]).all()
        assert np.allclose(ours[column][known], theirs[column][known], atol=0.02 * scale), column
    assert abs(theirs["tilt_work_J"][-1]) > 1.5 * abs(theirs["tilt_work_J"][3]) > 0.0


def test_the_summary_covers_the_whole_run(runs):
    _, (whole, resumed) = runs
    assert resumed["resumed_at_s"] == pytest.approx(CUT) and whole["resumed_at_s"] is None
    assert resumed["frames"] == whole["frames"] == 6
    assert resumed["steps"] == pytest.approx(whole["steps"], abs=2)
    for key in ("mass_change", "energy_gain", "volume_error_mean", "solver_residual_mean"):
        assert resumed["errors"][key] == pytest.approx(whole["errors"][key], abs=2e-3), key


def test_a_checkpoint_at_the_end_of_the_scene_is_refused(tmp_path):
    scene = load(tmp_path)
    with pytest.raises(CheckpointError, match=r"is at 0.2 s and the run ends at 0.2 s"):
        Measurement(tmp_path, scene, "small", "cpu", bar=False, since=0.2)
    assert not (tmp_path / "ledger.csv").exists()


def test_a_blow_up_leaves_a_checkpoint_of_the_last_good_frame(tmp_path):
    """Regression: the checkpoint was up to 10 s older, if there was one."""
    scene = load(tmp_path)
    show = Show(scene, EVERY, timings=Timings())
    measurement = Measurement(tmp_path, scene, "small", "cpu", bar=False)

    class Blow(Measurement):
        def wants_more(self, row):
            if self.done == 2:
                row.lead.simulation.particles.fields["v"][3] = [np.nan, 0.0, 0.0]
            return super().wants_more(row)

    measurement.__class__ = Blow
    with pytest.raises(NotFiniteError, match="particles are not finite"):
        run(Row([show]), measurement)
    measurement.conclude("blew up")
    with np.load(tmp_path / "checkpoint.npz") as state:
        assert float(state["time"]) == pytest.approx(2 * EVERY)
        assert np.isfinite(state["v"]).all()
