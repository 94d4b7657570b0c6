"""Tests of the stand-alone density check against the program's densities, on moving water."""

import re
from pathlib import Path

import numpy as np
import pytest

from bench import tanks
from msph.measure.bulk import bulk_density
from msph.measure.kernel_density import kernel_density, kernel_sums
from tests.command_kit import python

SCRIPT = Path(__file__).parents[2] / "bench" / "density_check.py"


@pytest.mark.parametrize("layers", [1, 3])
def test_stand_alone_density_check_agrees_within_ten_percent(tmp_path, layers):
    """The script imports nothing of msph and agrees on water that moves and is then compressed by
    3 %, so that the error of its bulk density is known."""
    water = {"lo": [0, 0, 0], "hi": [0.5, 0.5, 0.5], "jitter": 0.3}
    sim = tanks.build(tanks.scene((0.5, 0.8, 0.5), 0.5 / 12, layers, [water]))
    tanks.run(sim, 0.2)
    state = sim.state()
    state["x"] = (state["x"] * np.array([1.0, 0.97, 1.0])).astype(np.float32)
    np.savez(tmp_path / "state.npz", **state)
    spacing = np.array([s.spacing for s in sim.layers.specs])[state["layer"]]
    x = state["x"].astype(float)
    own, bulk = kernel_density(x, spacing, sim.size), bulk_density(x, spacing, sim.size).mean - 1.0
    assert bulk == pytest.approx(0.03, abs=0.01)
    code = f"import sys; sys.argv = ['', {str(tmp_path / 'state.npz')!r}]\n"
    code += SCRIPT.read_text() + "\nassert not [m for m in sys.modules if m.startswith('msph')]"
    done = python("-c", code)
    mean, p99, found = (float(n) / 100.0 for n in re.findall(r"([+-]?[\d.]+) %", done.stdout))
    assert mean == pytest.approx(own.mean, rel=0.1) and mean > 0.01
    assert p99 == pytest.approx(own.p99, rel=0.1)
    assert found == pytest.approx(bulk, rel=0.1)


def test_kernel_sums_equal_brute_force():
    rng = np.random.default_rng(4)
    x, size = rng.uniform(0.0, 0.2, (40, 3)), (0.6, 0.6, 0.6)
    d = np.where(rng.random(40) < 0.5, 0.05, 0.08)
    signs = np.array(np.meshgrid(*[(1, -1)] * 3)).reshape(3, -1).T
    images = np.concatenate([x * s for s in signs])
    h = 2.45 * ((d[:, None] ** 2.5 + np.tile(d, 8) ** 2.5) / 2) ** 0.4
    q = np.linalg.norm(x[:, None] - images, axis=2) / h
    parts = [np.clip(end - q, 0.0, None) ** 4 for end in (1.0, 0.6, 0.2)]
    w = 15625 / (512 * np.pi * h**3) * (parts[0] - 5 * parts[1] + 10 * parts[2])
    assert kernel_sums(x, d, size) == pytest.approx((np.tile(d, 8) ** 3 * w).sum(axis=1), rel=1e-6)
