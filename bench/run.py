"""Runs benches and writes their reports to bench/results.

python bench/run.py [NAME ...] [--only TABLE] [--case TEXT] [--starts 3] [--resume] [--draw]
                             [--arch cpu] [--threads 1]

Every case and start is a separate process, whose rows are written to bench/results/NAME.csv when it
ends; --resume measures only what is missing there. Rows of cases that are not requested are kept.
Starts differ in the random initial displacements of the particles.
"""

import json
import sys
from pathlib import Path

import click
from tqdm import tqdm

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from bench import rows, tables
from bench.rows import RESULTS, place
from msph.device import ARCHES, start

# Time limit of a run [s].
MAX_SECONDS = 7200.0


def work(name: str, table: str, case: str, seed: int, arch: str, threads: int | None) -> dict:
    """Measures a run in this process; returns its rows and the place."""
    bench = tables.bench_of(name)
    given = bench.tables[table].arch
    found = start(given or arch, threads, tested=bool(given))
    return {"rows": tables.measured(bench, table, case, seed), "measured": place(found, threads)}


def measure(name: str, only, case: str, starts, resume: bool, arch: str, threads) -> None:
    """Measures the requested runs of a bench, and writes its rows after each."""
    bench, path = tables.bench_of(name), RESULTS / f"{name}.csv"
    requested = tables.tasks(bench, only, case, starts)
    known, keys = rows.read(path), {tuple(map(str, task)) for task in requested}
    if not resume:
        known = [row for row in known if tables.key(row) not in keys]
    done = {tables.key(row) for row in known if not row.get("failure") and not bench.stale(row)}
    for task in tqdm([t for t in requested if tuple(map(str, t)) not in done], unit="run"):
        own = dict(zip(tables.KEYS, task, strict=True))
        known = [row for row in known if tables.key(row) != tables.key(own)]
        found = rows.in_process(__file__, (name, *task, arch, threads), MAX_SECONDS)
        if "failure" in found:
            click.echo(f"{', '.join(map(str, task))}: {found['failure']}", err=True)
        each = found.pop("rows", [{}])
        known += [own | {"measured": place(arch, threads)} | found | row for row in each]
        rows.write(path, known)


@click.command()
@click.argument("names", nargs=-1, type=click.Choice(list(tables.MODULES)))
@click.option("--only", multiple=True, help="First letters of tables. Repeatable.")
@click.option("--case", default="", help="Part of the first cells of rows.")
@click.option("--starts", type=click.IntRange(1), help="Number of random initial arrangements.")
@click.option("--resume", is_flag=True, help="Measure only what is missing.")
@click.option("--draw", is_flag=True, help="Only write the report of the stored rows.")
@click.option("--arch", type=click.Choice(ARCHES), default="auto", show_default=True)
@click.option("--threads", type=click.IntRange(1), help="CPU threads, by default one per core.")
@click.option("--worker", hidden=True, help="Measure one run, given as JSON.")
def main(names, only, case, starts, resume, draw, arch, threads, worker) -> None:
    """Measure the benches NAMES (default: all) and write bench/results/NAME.{csv,md}."""
    if worker:
        print(json.dumps(work(*json.loads(worker)), default=float), flush=True)
        return
    names = names or tables.MODULES
    found = (tables.tasks(tables.bench_of(name), only, case, starts) for name in names)
    if not any(found):
        listed = ", ".join(table for name in names for table in tables.bench_of(name).tables)
        raise click.UsageError(f"no run has this --only and --case; tables: {listed}")
    for name in names:
        if not draw:
            measure(name, only, case, starts, resume, arch, threads)
        known = rows.read(RESULTS / f"{name}.csv")
        click.echo(tables.report(name, tables.bench_of(name), known))


if __name__ == "__main__":
    main()
