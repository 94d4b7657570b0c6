"""Test of an installed package: pip into an empty environment, then the first program of the page.

It downloads Taichi and other packages, so that only `make installation` runs it.
"""

import os
import subprocess
import sys
import venv
from pathlib import Path

import pytest

from tests.test_python_page import BLOCKS

ROOT = Path(__file__).parent.parent


@pytest.mark.skipif(not os.environ.get("MSPH_INSTALLATION"), reason="run by make installation")
def test_the_first_program_runs_with_an_installed_package(tmp_path):
    home, work = tmp_path / "env", tmp_path / "work"
    work.mkdir()
    venv.create(home, with_pip=True)
    python = home / ("Scripts" if sys.platform == "win32" else "bin") / "python"
    install = [python, "-m", "pip", "install", "--quiet", "-c", ROOT / "constraints.txt", ROOT]
    subprocess.run(install, check=True)
    clean = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    where = [python, "-c", "import msph; print(msph.__file__)"]
    found = subprocess.run(where, capture_output=True, text=True, cwd=work, env=clean, check=True)
    assert Path(found.stdout.strip()).is_relative_to(home)
    (work / "first.py").write_text(BLOCKS["M-SPH in Python"])
    subprocess.run([python, "first.py"], check=True, cwd=work, env=clean)
    assert (work / "dam.mp4").stat().st_size > 10_000 and (work / "state.npz").is_file()
