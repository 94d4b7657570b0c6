"""Speed against error: runs every case with each method, kind of water, spacing and setting.

python bench/pareto.py [--quick] [--case NAME] [--resume] [--cluster ADDRESS] [--arch cpu]

Every row is a run in a separate process, one at a time, and is written to bench/results/pareto.csv
when it ends. --resume continues there, and repeats runs that other busy processes disturbed. Runs
whose time does not matter, the references of self-convergence, can run on an existing Dask cluster
(pip install '.[cluster]', with this checkout on the workers). bench/results/pareto.md and
pareto*.png are generated from the CSV file.
"""

import dataclasses
import json
import sys
from pathlib import Path

import click
from tqdm import tqdm

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from bench import rows
from bench.cases import CASES
from bench.cases.case import Setting
from bench.pareto_table import disturbed, key, row_of
from bench.report import RESULTS
from msph.device import ARCHES, start

TABLE = "pareto.csv"
# Figures of timed rows only.
TIMED = ("wall_per_simulated", "peak_mib", "others")
# Time limit of a run [s].
MAX_SECONDS = 1800


def run(case: str, setting: Setting, arch: str) -> dict[str, float]:
    """Returns the figures of a row, measured in this process."""
    start(arch)
    done, found = CASES[case].measure(setting)
    costs = done.costs()
    if not setting.timed:
        costs = {k: v for k, v in costs.items() if k not in TIMED}
    return {**costs, **found}


def in_process(case: str, setting: dict, arch: str) -> dict[str, float | str]:
    """Runs run() in a separate process."""
    task = {"case": case, "setting": setting, "arch": arch}
    return rows.in_process(__file__, task, MAX_SECONDS)


def sweep(names: tuple[str, ...], quick: bool, known: list[dict], arch: str, cluster: str) -> None:
    """Measures every row that is unknown or was disturbed, and writes the table after each."""
    requested = [(name, setting) for name in names for setting in CASES[name].settings(quick)]
    done = {key(row) for row in known if not disturbed(row)}
    todo = [(n, s) for n, s in requested if key({"case": n, **dataclasses.asdict(s)}) not in done]
    elsewhere = [(n, s) for n, s in todo if not s.timed] if cluster else []
    pending = submit(cluster, elsewhere, arch) if elsewhere else []
    for name, setting in tqdm([t for t in todo if t not in elsewhere], unit="run"):
        found = in_process(name, dataclasses.asdict(setting), arch)
        keep(row_of(name, setting, arch, found), known)
    for (name, setting), future in zip(elsewhere, pending, strict=True):
        keep(row_of(name, setting, arch, future.result()), known)


def keep(row: dict, known: list[dict]) -> None:
    """Adds a row to the table, or replaces the row of the same run."""
    known[:] = [other for other in known if key(other) != key(row)] + [row]
    rows.write(RESULTS / TABLE, known)


def submit(address: str, tasks: list[tuple[str, Setting]], arch: str) -> list:
    """Submits untimed rows to a cluster; returns their futures."""
    try:
        from distributed import Client
    except ImportError as error:
        raise click.UsageError("--cluster needs: pip install '.[cluster]'") from error
    client = Client(address)
    return [client.submit(in_process, n, dataclasses.asdict(s), arch) for n, s in tasks]


@click.command()
@click.option("--quick", is_flag=True, help="Coarse runs only: minutes instead of hours.")
@click.option(
    "--case",
    "cases",
    multiple=True,
    type=click.Choice(list(CASES)),
    help="Run only this case. Repeatable.",
)
@click.option("--resume", is_flag=True, help="Keep the rows of earlier runs.")
@click.option("--cluster", default="", help="Address of a Dask scheduler for untimed runs.")
@click.option("--draw", is_flag=True, help="Only write the report and figures of the stored rows.")
@click.option("--arch", type=click.Choice(ARCHES), default="auto", show_default=True)
@click.option("--worker", hidden=True)
def main(quick, cases, resume, cluster, draw, arch, worker) -> None:
    """Run the cases and write bench/results/pareto.{csv,md,png} and a figure for each case."""
    if worker:
        task = json.loads(worker)
        print(json.dumps(run(task["case"], Setting(**task["setting"]), task["arch"])))
        return
    from bench.pareto_report import report

    cases = cases or tuple(CASES)
    known = rows.read(RESULTS / TABLE)
    if not resume and not draw:
        known = [row for row in known if row["case"] not in cases]
    RESULTS.mkdir(exist_ok=True)
    if not draw:
        sweep(cases, quick, known, start(arch), cluster)
    report(known, RESULTS)


if __name__ == "__main__":
    main()
