"""Test that runs the notebooks of docs/notebooks, with short simulations."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
NOTEBOOKS = sorted((ROOT / "docs" / "notebooks").glob("*.ipynb"))
# Simulated time [s] of a run.
SECONDS = 0.1


@pytest.mark.slow
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs_and_shows_figures_and_a_film(path, tmp_path):
    nbformat, nbclient = pytest.importorskip("nbformat"), pytest.importorskip("nbclient")
    pytest.importorskip("ipykernel")
    folder = tmp_path / "docs" / "notebooks"
    folder.mkdir(parents=True)
    (tmp_path / "assets").symlink_to(ROOT / "assets")
    text = re.sub(r"SECONDS(, \w+)? = [0-9.]+", rf"SECONDS\1 = {SECONDS}", path.read_text())
    book = nbformat.reads(text, as_version=4)
    assert not any(cell.get("outputs") for cell in book.cells), "stored without results"
    nbclient.NotebookClient(
        book, timeout=300, resources={"metadata": {"path": str(folder)}}
    ).execute()
    shown = [kind for c in book.cells for o in c.get("outputs", ()) for kind in o.get("data", ())]
    assert "image/png" in shown and "text/html" in shown
