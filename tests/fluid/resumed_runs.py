"""Runs that are stopped and resumed, in a process of one thread: see test_resume.py.

python tests/fluid/resumed_runs.py FOLDER: for each case FOLDER/CASE_whole.npz holds the end of the
run that was never stopped, CASE_resumed.npz that of the run that went on from a checkpoint, and
CASE_events.npy the particles (made, gone) before and after the checkpoint, (2, 2).
"""

import sys
from pathlib import Path

import numpy as np

from msph.device import start
from msph.fluid.external_forces import ExternalForces
from msph.fluid.simulation import Simulation
from msph.scene import load_scene
from msph.scene.build import build_simulation

FRAME = 1.0 / 60.0
COARSE = [f"layers.{k}.spacing={0.05 * 2 ** (k / 3):.6f}" for k in range(3)]
# Frequent passes, narrow hysteresis, and so little room that bands grow thin and thick again: the
# splash splits and merges all the time, and all that adaptation carries matters.
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
    """Runs so many frames; returns how many particles (were made, are gone)."""
    made, gone = 0, 0
    for _ in range(frames):
        before = set(sim.particles.numpy("id").tolist())
        sim.advance(FRAME, ExternalForces())
        after = set(sim.particles.numpy("id").tolist())
        made, gone = made + len(after - before), gone + len(before - after)
    return made, gone


def compare(case: str, folder: Path) -> None:
    """Writes the two ends of one case, and its splits and merges."""
    name, changes, (before, after) = CASES[case]
    sim = build_simulation(load_scene(name, changes))
    events = [advance(sim, before)]
    np.savez_compressed(folder / f"{case}.npz", **sim.state())
    events.append(advance(sim, after))
    np.savez(folder / f"{case}_whole.npz", **sim.state())
    # As after a start, but for what a reset would forget to clear.
    sim.reset()
    with np.load(folder / f"{case}.npz") as state:
        sim.restore(dict(state))
    advance(sim, after)
    np.savez(folder / f"{case}_resumed.npz", **sim.state())
    np.save(folder / f"{case}_events.npy", np.array(events))


if __name__ == "__main__":
    start("cpu", threads=1)
    for case in CASES:
        compare(case, Path(sys.argv[1]))
