"""Speed against error: runs every case with each method, kind of water, spacing and setting.

python bench/pareto.py [--quick] [--case NAME] [--only water=uniform] [--resume] [--busy]
                       [--arch cpu] [--threads 1]

Every row is a run in a separate process, one at a time, and is written to bench/results/pareto.csv
when it ends; all settings run with the first start before the next, so that an interrupted sweep
has the medians of fewer starts. --resume continues there, and repeats runs that other busy
processes disturbed, unless --busy keeps them. With --threads 1 other programs may use the other
cores. DFSPH needs pip install '.[peers]'. bench/results/pareto.md and pareto*.png are generated
from the CSV file.
"""

import dataclasses
import json
import os
import sys
from pathlib import Path

import click
from tqdm import tqdm

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from bench import peer_splishsplash, rows
from bench.cases import CASES
from bench.cases.case import DFSPH, Setting
from bench.pareto_table import KEYS, disturbed, key, row_of
from bench.report import RESULTS
from msph.device import ARCHES, start

TABLE = "pareto.csv"
# Figures of timed rows only.
TIMED = ("wall_per_simulated", "peak_mib", "others")
# Time limit of a run [s].
MAX_SECONDS = 1800


def run(case: str, setting: Setting, arch: str, threads: int) -> dict[str, float]:
    """Returns the figures of a row, measured in this process with this number of CPU threads."""
    if setting.method == DFSPH:
        os.environ["OMP_NUM_THREADS"] = str(threads)
    else:
        start(arch, threads)
    done, found = CASES[case].measure(setting)
    costs = done.costs()
    if not setting.timed:
        costs = {k: v for k, v in costs.items() if k not in TIMED}
    return {**costs, **found}


def in_process(case: str, setting: dict, arch: str, threads: int) -> dict[str, float | str]:
    """Runs run() in a separate process."""
    task = {"case": case, "setting": setting, "arch": arch, "threads": threads}
    return rows.in_process(__file__, task, MAX_SECONDS)


def requested(names: tuple[str, ...], quick: bool, only: dict[str, str]) -> list:
    """Returns the cases and settings to measure, one start after the other. only: values of the
    settings, as in the table."""
    every = [(name, setting) for name in names for setting in CASES[name].settings(quick)]
    if peer_splishsplash.missing():
        click.echo("pySPlisHSPlasH is not installed: skipped (pip install '.[peers]')")
        every = [(name, setting) for name, setting in every if setting.method != DFSPH]

    def wanted(setting: Setting) -> bool:
        own = dict(zip(KEYS, key({"case": "", **dataclasses.asdict(setting)}), strict=True))
        return all(own[name] == value for name, value in only.items())

    return sorted((t for t in every if wanted(t[1])), key=lambda task: task[1].start)


def sweep(tasks: list, known: list[dict], arch: str, threads: int, busy: bool) -> None:
    """Measures every row that is unknown or was disturbed, and writes the table after each."""
    done = {key(row) for row in known if busy or not disturbed(row)}
    todo = [(n, s) for n, s in tasks if key({"case": n, **dataclasses.asdict(s)}) not in done]
    for name, setting in tqdm(todo, unit="run"):
        found = in_process(name, dataclasses.asdict(setting), arch, threads)
        keep(row_of(name, setting, arch, threads, found), known)


def keep(row: dict, known: list[dict]) -> None:
    """Adds a row to the table, or replaces the row of the same run."""
    known[:] = [other for other in known if key(other) != key(row)] + [row]
    rows.write(RESULTS / TABLE, known)


@click.command()
@click.option("--quick", is_flag=True, help="Coarse runs only: minutes instead of hours.")
@click.option(
    "--case",
    "cases",
    multiple=True,
    type=click.Choice(list(CASES)),
    help="Run only this case. Repeatable.",
)
@click.option(
    "--only", "only", multiple=True, metavar="NAME=VALUE", help="Settings to run. Repeatable."
)
@click.option("--resume", is_flag=True, help="Keep the rows of earlier runs.")
@click.option("--busy", is_flag=True, help="Keep rows that other processes disturbed, too.")
@click.option("--draw", is_flag=True, help="Only write the report and figures of the stored rows.")
@click.option("--arch", type=click.Choice(ARCHES), default="auto", show_default=True)
@click.option("--threads", type=click.IntRange(1), help="CPU threads, by default one per core.")
@click.option("--worker", hidden=True)
def main(quick, cases, only, resume, busy, draw, arch, threads, worker) -> None:
    """Run the cases and write bench/results/pareto.{csv,md,png} and a figure for each case."""
    if worker:
        task = json.loads(worker)
        found = run(task["case"], Setting(**task["setting"]), task["arch"], task["threads"])
        print(json.dumps(found), flush=True)
        os._exit(0)  # other programs may crash when they exit
    from bench.pareto_report import report

    cases = cases or tuple(CASES)
    known = rows.read(RESULTS / TABLE)
    chosen = dict(pair.split("=", 1) for pair in only)
    if set(chosen) - set(KEYS):
        raise click.UsageError(f"--only: known names are {', '.join(KEYS[1:])}")
    if not (resume or draw or only):
        known = [row for row in known if row["case"] not in cases]
    RESULTS.mkdir(exist_ok=True)
    if not draw:
        threads = threads or os.cpu_count() or 1
        sweep(requested(cases, quick, chosen), known, start(arch), threads, busy)
    report(known, RESULTS)


if __name__ == "__main__":
    main()
