"""Test that runs the notebooks of docs/notebooks in this process, with short simulations."""

import os
import re
from pathlib import Path

import matplotlib
import matplotlib.pyplot as plt
import pytest

from tests.command_kit import python

ROOT = Path(__file__).parent.parent
NOTEBOOKS = sorted((ROOT / "docs" / "notebooks").glob("*.ipynb"))
# Simulated time [s] of a run.
SECONDS = 0.1


def test_an_import_in_a_notebook_prints_nothing():
    """Regression: Taichi's "Graphical python shell detected" was in red above the first result."""
    code = "import io, sys; sys.stdout = io.StringIO(); import msph; msph.Water"
    clean = {k: v for k, v in os.environ.items() if k != "TI_ENABLE_PYBUF"}
    found = python("-c", code, env=clean)
    assert found.stdout + found.stderr == ""


@pytest.mark.slow
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs_and_shows_figures_and_a_film(path, tmp_path, monkeypatch):
    nbformat = pytest.importorskip("nbformat")
    interactive = pytest.importorskip("IPython.core.interactiveshell")
    monkeypatch.setenv("IPYTHONDIR", str(tmp_path))
    folder = tmp_path / "docs" / "notebooks"
    folder.mkdir(parents=True)
    (tmp_path / "assets").symlink_to(ROOT / "assets")
    monkeypatch.chdir(folder)
    matplotlib.use("Agg")
    text = re.sub(r"SECONDS(, \w+)? = [0-9.]+", rf"SECONDS\1 = {SECONDS}", path.read_text())
    book, shown = nbformat.reads(text, as_version=4), []
    assert not any(cell.get("outputs") for cell in book.cells), "stored without results"
    monkeypatch.setattr(plt, "show", lambda: shown.extend(["image/png"] * len(plt.gcf().axes)))
    shell = interactive.InteractiveShell.instance()
    for cell in book.cells:
        if cell.cell_type == "code":
            found = shell.run_cell(cell.source)
            found.raise_error()
            if found.result is not None:
                shown += shell.display_formatter.format(found.result)[0]
    plt.close("all")
    assert "image/png" in shown and "text/html" in shown
