"""A run that goes on from a checkpoint file is the run that was never stopped, bit for bit."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

SCRIPT = Path(__file__).with_name("resumed_runs.py")


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """The folder of their ends. Bits repeat on one thread only, and threads are a process's."""
    folder = tmp_path_factory.mktemp("runs")
    command = [sys.executable, str(SCRIPT), str(folder)]
    result = subprocess.run(command, capture_output=True, text=True)
    assert result.returncode == 0, result.stderr
    return folder


@pytest.mark.parametrize("case", ["adaptive", "classic"])
def test_a_resumed_run_equals_the_whole_one(runs, case):
    """Every carried attribute of every particle, in its order, and the state of the solver."""
    with (
        np.load(runs / f"{case}_whole.npz") as whole,
        np.load(runs / f"{case}_resumed.npz") as ours,
    ):
        assert set(whole) == set(ours) >= {"x", "v", "layer", "id", "time", "steps", "last_step"}
        with np.load(runs / f"{case}.npz") as checkpoint:
            assert checkpoint["time"] < whole["time"]
        differing = [name for name in whole if whole[name].tobytes() != ours[name].tobytes()]
    assert not differing


def test_particles_split_and_merged_on_both_sides_of_the_checkpoint(runs):
    """Else the equality above would say nothing about what adaptation carries."""
    assert np.load(runs / "adaptive_events.npy").min() > 0
