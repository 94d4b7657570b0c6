"""Speed against error of each method, water, spacing and setting, over the whole range.

python bench/pareto.py [--quick] [--case NAME] [--resume] [--cluster ADDRESS] [--arch cpu]

Every row is a run in a process of its own, one at a time; it is written to bench/results/pareto.csv
as soon as it is measured, where --resume takes up again. Rows of which only errors are wanted, the
references of self-convergence, may be handed to a Dask scheduler that exists: pip install
'.[cluster]', and this checkout at the workers. bench/results/pareto.md and pareto*.png are drawn
from the table alone.
"""

import csv
import dataclasses
import datetime
import json
import subprocess
import sys
from pathlib import Path

import click
from tqdm import tqdm

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from bench.cases import CASES
from bench.cases.case import Setting
from bench.report import RESULTS
from msph.device import ARCHES, start
from msph.measure.machine import machine

TABLE = "pareto.csv"
KEYS = ["case", *(f.name for f in dataclasses.fields(Setting))]
# A run that takes longer [s] is given up, and said.
MOST_SECONDS = 1800


def run(case: str, setting: Setting, arch: str) -> dict[str, float]:
    """A row's figures, measured in this process."""
    start(arch)
    done, found = CASES[case].measure(setting)
    costs = done.costs()
    if not setting.timed:
        costs = {k: v for k, v in costs.items() if k not in ("wall_per_simulated", "peak_mib")}
    return {**costs, **found}


def in_process(case: str, setting: dict, arch: str) -> dict[str, float | str]:
    """The same in a process of its own; of a run that fails, its last line as "failure"."""
    task = json.dumps({"case": case, "setting": setting, "arch": arch})
    command = [sys.executable, str(Path(__file__).resolve()), "--worker", task]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=MOST_SECONDS)
    except subprocess.TimeoutExpired:
        return {"failure": f"longer than {MOST_SECONDS} s"}
    lines = (done.stdout if done.returncode == 0 else done.stderr).strip().splitlines()
    last = lines[-1] if lines else f"exit status {done.returncode}"
    return json.loads(last) if done.returncode == 0 else {"failure": last[:200]}


def read(path: Path) -> list[dict[str, str]]:
    """Rows of a table; none where there is no file."""
    if not path.exists():
        return []
    with open(path, newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def write(path: Path, rows: list[dict]) -> None:
    """Writes them beside and renames, so that a run that is stopped keeps what it had."""
    heads = list(dict.fromkeys([*KEYS, *(k for row in rows for k in row)]))
    beside = path.with_suffix(".part")
    with open(beside, "w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, heads)
        writer.writeheader()
        writer.writerows(rows)
    beside.replace(path)


def key(row: dict) -> tuple[str, ...]:
    """What tells a row from others; numbers as they are written to the table."""
    return tuple("" if row[k] is None else str(row[k]) for k in KEYS)


def row_of(case: str, setting: Setting, arch: str, found: dict) -> dict:
    """A table's row: what was run, when, where, and what was found."""
    numbers = {k: v if isinstance(v, str) else f"{v:.5g}" for k, v in found.items()}
    today = datetime.date.today().isoformat()
    where = {"arch": arch, "machine": machine(), "date": today}
    return {"case": case, **dataclasses.asdict(setting), **where, **numbers}


def sweep(names: tuple[str, ...], quick: bool, known: list[dict], arch: str, cluster: str) -> None:
    """Measures every row that is not known, and writes the table after each."""
    asked = [(name, setting) for name in names for setting in CASES[name].settings(quick)]
    done = {key(row) for row in known}
    todo = [(n, s) for n, s in asked if key({"case": n, **dataclasses.asdict(s)}) not in done]
    elsewhere = [(n, s) for n, s in todo if not s.timed] if cluster else []
    pending = submit(cluster, elsewhere, arch) if elsewhere else []
    for name, setting in tqdm([t for t in todo if t not in elsewhere], unit="run"):
        found = in_process(name, dataclasses.asdict(setting), arch)
        known.append(row_of(name, setting, arch, found))
        write(RESULTS / TABLE, known)
    for (name, setting), future in zip(elsewhere, pending, strict=True):
        known.append(row_of(name, setting, arch, future.result()))
        write(RESULTS / TABLE, known)


def submit(address: str, tasks: list[tuple[str, Setting]], arch: str) -> list:
    """Futures of rows of which only errors are wanted, on a cluster."""
    try:
        from distributed import Client
    except ImportError as error:
        raise click.UsageError("--cluster needs: pip install '.[cluster]'") from error
    client = Client(address)
    return [client.submit(in_process, n, dataclasses.asdict(s), arch) for n, s in tasks]


@click.command()
@click.option("--quick", is_flag=True, help="Coarse runs alone: minutes, not hours.")
@click.option("--case", "cases", multiple=True, type=click.Choice(list(CASES)))
@click.option("--resume", is_flag=True, help="Keep the rows that were measured before.")
@click.option("--cluster", default="", help="Address of a Dask scheduler for errors alone.")
@click.option("--draw", is_flag=True, help="Measure nothing; draw the table that there is.")
@click.option("--arch", type=click.Choice(ARCHES), default="auto", show_default=True)
@click.option("--worker", hidden=True)
def main(quick, cases, resume, cluster, draw, arch, worker) -> None:
    """Measure, and write bench/results/pareto.{csv,md,png} and a figure for each case."""
    if worker:
        task = json.loads(worker)
        print(json.dumps(run(task["case"], Setting(**task["setting"]), task["arch"])))
        return
    from bench.pareto_report import report

    cases = cases or tuple(CASES)
    known = read(RESULTS / TABLE)
    if not resume and not draw:
        known = [row for row in known if row["case"] not in cases]
    RESULTS.mkdir(exist_ok=True)
    if not draw:
        sweep(cases, quick, known, start(arch), cluster)
    report(known, RESULTS)


if __name__ == "__main__":
    main()
