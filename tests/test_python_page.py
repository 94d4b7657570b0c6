"""Tests that run the code of docs/python.md, with runs of a few frames."""

import ast
import importlib.util
import re
from pathlib import Path

import pytest

from msph.water import Water
from tests.command_kit import python
from tests.tiers import slow_but

PAGE = (Path(__file__).parent.parent / "docs" / "python.md").read_text(encoding="utf-8")
BLOCKS = dict(re.findall(r"^#+ ([^\n]+)\n(?:(?!^#).)*?^```python\n(.*?)^```", PAGE, re.M | re.S))
# Largest number of frames of a run.
FRAMES = 3


def imported(code):
    """Returns the packages that a program imports."""
    nodes = [n for n in ast.walk(ast.parse(code)) if isinstance(n, ast.Import | ast.ImportFrom)]
    return {name.split(".")[0] for n in nodes for name in [getattr(n, "module", n.names[0].name)]}


def test_there_are_ten_recipes_and_the_snippet():
    assert len(BLOCKS) >= 11


# All recipes but the one that starts processes.
FAST = [title for title, code in BLOCKS.items() if "__main__" not in code]


@pytest.mark.parametrize("title", slow_but(FAST, BLOCKS))
def test_code_of_the_page_runs(title, tmp_path, monkeypatch):
    code = BLOCKS[title]
    for package in imported(code):
        if importlib.util.find_spec(package) is None:
            pytest.skip(f"needs {package}")
    monkeypatch.chdir(tmp_path)
    if "__main__" in code:
        # Dask's process imports the program.
        code = re.sub(r"seconds=\d\.\d", "seconds=0.1", code).replace("workers=2", "workers=1")
        (tmp_path / "batch.py").write_text(code)
        python("batch.py")
        return
    count = Water._count
    monkeypatch.setattr(Water, "_count", lambda *given: min(count(*given), FRAMES))
    exec(compile(code, title, "exec"), {"__name__": title})
