"""A run resumed from a checkpoint file equals the uninterrupted run bit for bit."""

from pathlib import Path

import numpy as np
import pytest
import taichi as ti

from msph.fluid.external_forces import ExternalForces
from msph.fluid.simulation import Simulation
from msph.scene import load_scene
from msph.scene.build import build_simulation
from msph.taichi_internals import on_cpu
from tests.fluid.fluid_kit import leave_in_copies

FRAME = 1.0 / 60.0
COARSE = [f"layers.{k}.spacing={0.05 * 2 ** (k / 3):.6f}" for k in range(3)]
# Frequent passes, a narrow hysteresis and so small a capacity that bands shrink and grow: the
# splash splits and merges all the time, so that every value carried by adaptation matters.
BUSY = (
    *("adaptation.every=2", "adaptation.travel=0.3", "adaptation.hysteresis=0.1"),
    "adaptation.capacity=1290",
)
# Scene, changes, and frames before and after the checkpoint.
CASES: dict[str, tuple[str, tuple[str, ...], tuple[int, int]]] = {
    "adaptive": ("drop", ("method=projection", *COARSE, *BUSY), (16, 16)),
    "classic": ("drop", ("method=classic", "adaptation.enabled=false", *COARSE), (4, 4)),
}


def advance(sim: Simulation, frames: int) -> tuple[int, int]:
    """Runs `frames` frames; returns the numbers of particles (made, removed) in them."""
    made, gone = 0, 0
    for _ in range(frames):
        before = set(sim.particles.numpy("id").tolist())
        sim.advance(FRAME, ExternalForces())
        after = set(sim.particles.numpy("id").tolist())
        made, gone = made + len(after - before), gone + len(before - after)
    return made, gone


def compare(case: str, folder: Path) -> None:
    """Writes the final states of the uninterrupted run, CASE_whole.npz, and of the run resumed from
    the checkpoint CASE.npz, CASE_resumed.npz; and CASE_events.npy, the numbers of particles (made,
    removed) before and after the checkpoint, (2, 2)."""
    name, changes, (before, after) = CASES[case]
    sim = build_simulation(load_scene(name, changes))
    leave_in_copies(sim, 1)
    events = [advance(sim, before)]
    np.savez_compressed(folder / f"{case}.npz", **sim.state())
    events.append(advance(sim, after))
    np.savez(folder / f"{case}_whole.npz", **sim.state())
    # The state is restored after a reset, so that values that reset() fails to clear are noticed.
    sim.reset()
    with np.load(folder / f"{case}.npz") as state:
        sim.restore(dict(state))
    advance(sim, after)
    np.savez(folder / f"{case}_resumed.npz", **sim.state())
    np.save(folder / f"{case}_events.npy", np.array(events))
    sim.close()


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Returns the folder with the files of all cases. Bits repeat on a single thread only."""
    if not on_cpu() or ti.cfg.cpu_max_num_threads > 1:
        pytest.skip("needs a single CPU thread")
    folder = tmp_path_factory.mktemp("runs")
    for case in CASES:
        compare(case, folder)
    return folder


@pytest.mark.parametrize("case", ["adaptive", "classic"])
def test_a_resumed_run_equals_the_uninterrupted_run(runs, case):
    """All carried attributes of all particles, in order, and the state of the solver are equal."""
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
    """Splits and merges occur on both sides; otherwise equality would not test adaptation's
    state."""
    assert np.load(runs / "adaptive_events.npy").min() > 0
