"""Speed against error: every case with each method, kind of water, spacing and setting.

A table for each case of bench/cases. --resume also repeats runs that other busy processes
disturbed; with --threads 1 other programs may use the other cores. DFSPH needs
pip install '.[peers]'.
"""

import atexit
import dataclasses
import os
from functools import partial

import taichi as ti

from bench import pareto_report, peer_splishsplash
from bench.cases import CASES
from bench.cases.case import DFSPH, Case, Setting
from bench.pareto_rows import HEADS, disturbed
from bench.tables import Bench, Table

# Figures of timed rows only.
TIMED = ("wall_per_simulated", "peak_mib", "others")


def figures(case: str, setting: Setting, start: int) -> dict[str, float]:
    """Returns the figures of a run."""
    if setting.method == DFSPH:
        os.environ["OMP_NUM_THREADS"] = str(ti.cfg.cpu_max_num_threads)
    done, found = CASES[case].measure(dataclasses.replace(setting, start=start))
    costs = {k: v for k, v in done.costs().items() if setting.timed or k not in TIMED}
    if setting.method == DFSPH:
        atexit.register(os._exit, 0)  # its thread still runs, and its process may crash
    return {**costs, **found}


def cells(setting: Setting) -> tuple[str, ...]:
    """Returns the first cells of the row of a setting."""
    return setting.method, setting.water, str(setting.resolution), setting.changes


def table(case: Case) -> Table:
    """Returns the table of a case, without DFSPH where SPlisHSPlasH is not installed."""
    settings = [s for s in case.settings() if s.method != DFSPH or not peer_splishsplash.missing()]
    runs = {cells(setting): partial(figures, case.name, setting) for setting in settings}
    forms = dict.fromkeys((*pareto_report.COSTS, *case.errors), ".3g")
    return Table(case.title, HEADS, runs, forms)


BENCHES = {
    "pareto": Bench(
        "Speed against error",
        "",
        {name: table(case) for name, case in CASES.items()},
        stale=lambda row: disturbed(row["measured"], float(row.get("others", "nan"))),
        write=pareto_report.report,
    )
}
