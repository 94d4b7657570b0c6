"""Tables of results: a bench is its cases, formats and targets, measured by bench/run.py."""

import importlib
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tabulate import tabulate

from bench import rows
from bench.rows import RESULTS

# Modules of the benches, by name.
MODULES = {
    "pareto": "bench.pareto",
    "accuracy": "bench.accuracy",
    "friction": "bench.friction",
    "boundaries": "bench.boundaries",
    "bodies": "bench.bodies",
    "moving": "bench.moving",
    "impact": "bench.impact",
    "layers": "bench.scale",
    "scale": "bench.scale",
    "methods": "bench.methods",
    "stability": "bench.stability",
    "random_input": "bench.random_input",
    "terms": "bench.terms",
    "constants": "bench.constants",
    "table_5_1": "bench.table_5_1",
    **dict.fromkeys(("scenes", "play", "quality", "visits", "vulkan"), "bench.scenes"),
    "peers": "bench.peer_surfaces",
}
# First cells of a row, as one text.
BETWEEN = " | "
# End of the title of a table that is measured again with some of its cases only.
IN_PART = ", measured again in part"
# Columns of a file of rows that are no cells of a table.
KEYS = ("table", "case", "start")
META = (*KEYS, "measured", "failure")

Figures = dict[str, Any]
# A figure that is declared once: its format, and its function of what was run.
Declared = dict[str, tuple[str, Callable[[Any], Any]]]
Case = Callable[[int], Figures | list[Figures]]


@dataclass(frozen=True)
class Table:
    """A table of results.

    title: in Markdown. heads: names of the first cells. cases: function of a start by the first
    cells of its row; it returns figures by name, or a list of them with further first cells, one
    for each row. forms: formats of the figures, such as ".1%"; other values are cells of their own.
    targets: of figures, in words. across: figures are rows and cases are columns. starts: number of
    random initial arrangements. arch: device, "" for the requested one.
    """

    title: str
    heads: tuple[str, ...]
    cases: dict[tuple[str, ...], Case]
    forms: dict[str, str]
    targets: dict[str, str] = field(default_factory=dict)
    across: bool = False
    starts: int = rows.STARTS
    arch: str = ""


@dataclass(frozen=True)
class Bench:
    """Tables that share a report. conclude(rows) returns further Markdown, computed from rows;
    stale(row): True for a row that --resume measures again; write(rows) writes and returns a report
    of another form."""

    title: str
    note: str
    tables: dict[str, Table]
    conclude: Callable[[list[dict]], list[str]] = lambda known: []
    stale: Callable[[dict], bool] = lambda row: False
    write: Callable[[list[dict]], str] | None = None


def figures(declared: Declared, found: Any) -> Figures:
    """Returns the values of declared figures for what was run, `found`."""
    return {name: of(found) for name, (_, of) in declared.items()}


def forms(declared: dict[str, tuple[str, Any]]) -> dict[str, str]:
    """Returns the formats of declared figures."""
    return {name: form for name, (form, _) in declared.items()}


def bench_of(name: str) -> Bench:
    """Returns a bench by name."""
    return importlib.import_module(MODULES[name]).BENCHES[name]


def key(row: dict) -> tuple[str, ...]:
    """Returns what identifies a run: table, case and start."""
    return tuple(str(row.get(name, "")) for name in KEYS)


def tasks(bench: Bench, only: tuple[str, ...], case: str, starts: int | None) -> list[tuple]:
    """Returns the runs, (table, case, start): all of a start before the next start. only: first
    letters of tables; case: part of the first cells."""
    found = [
        (name, BETWEEN.join(cells), seed)
        for name, table in bench.tables.items()
        for cells in table.cases
        for seed in range(starts or table.starts)
        if (not only or name.startswith(only)) and case in BETWEEN.join(cells)
    ]
    return sorted(found, key=lambda task: task[2])


def measured(bench: Bench, table: str, case: str, start: int) -> list[Figures]:
    """Returns the rows of a run, measured in this process."""
    cells = tuple(case.split(BETWEEN)) if case else ()
    found = bench.tables[table].cases[cells](start)
    return found if isinstance(found, list) else [found]


def groups(table: Table, own: list[dict]) -> dict[tuple[str, ...], dict[str, str]]:
    """Returns the cells of the figures by first cells: medians (least to largest) over starts."""
    order = [BETWEEN.join(cells) for cells in table.cases]
    own = [{**row, "case": row.get("case", "")} for row in own]
    own = sorted((row for row in own if row["case"] in order), key=lambda r: order.index(r["case"]))
    found: dict[tuple[str, ...], list[dict]] = {}
    for row in own:
        first = row["case"].split(BETWEEN) if row["case"] else []
        more = [v for k, v in row.items() if k not in META and k not in table.forms]
        found.setdefault((*first, *map(str, more)), []).append(row)
    cells = {}
    for first, same in found.items():
        known = {f: [float(r[f]) for r in same if f in r] for f in table.forms}
        cells[first] = {f: rows.spread(v, table.forms[f]) for f, v in known.items() if v}
        failures = "; ".join(r["failure"] for r in same if r.get("failure"))
        cells[first] |= {"failure": failures} if failures else {}
    return cells


def shown(table: Table, own: list[dict]) -> str:
    """Returns the rows of a table as Markdown."""
    found = groups(table, own)
    known = {name for cells in found.values() for name in cells}
    names = [name for name in (*table.forms, "failure") if name in known]
    if table.across:
        lines = []
        for name in names:
            target = {"target": table.targets.get(name, "")} if table.targets else {}
            cells = {", ".join(first): cells.get(name, "") for first, cells in found.items()}
            lines.append({"figure": name, **target, **cells})
        return markdown(lines)
    labels = [[k for k in row if k not in META and k not in table.forms] for row in own]
    heads = (*table.heads, *max(labels, key=len))
    return markdown(
        [
            {**dict(zip(heads, first, strict=False)), **{k: cells.get(k, "-") for k in names}}
            for first, cells in found.items()
        ]
    )


def markdown(lines: list[dict]) -> str:
    """Returns lines as a Markdown table."""
    return tabulate(lines, headers="keys", tablefmt="github", disable_numparse=True)


def stored(path: Path) -> dict[str, str]:
    """Returns the sections of a report by title."""
    parts = path.read_text(encoding="utf-8").split("\n## ")[1:] if path.exists() else []
    return {title: text.strip() for title, _, text in (part.partition("\n") for part in parts)}


def report(name: str, bench: Bench, known: list[dict]) -> str:
    """Writes and returns the report of the rows. Sections of the old report that are not measured
    again, with all cases, are kept, so that no figure is lost."""
    if bench.write:
        return bench.write(known)
    path = RESULTS / f"{name}.md"
    text, old = [f"# {bench.title}\n", f"`python bench/run.py {name}`\n", bench.note], stored(path)
    for table, its in bench.tables.items():
        own = [row for row in known if row["table"] == table]
        cases = {BETWEEN.join(cells) for cells in its.cases}
        part = bool(own) and not cases <= {row.get("case", "") for row in own}
        old.pop(f"{its.title}{IN_PART}", "")
        section = old.pop(its.title, "")
        if section and (part or not own):
            text += [f"\n## {its.title}\n", section]
        if own:
            where = dict.fromkeys(row["measured"] for row in own)
            title = f"{its.title}{IN_PART}" if part and section else its.title
            text += [f"\n## {title}\n", *(f"{line}\n" for line in where), shown(its, own)]
    concluded = "\n".join(bench.conclude(known))
    kept = [f"## {title}\n\n{its}\n" for title, its in old.items() if title not in concluded]
    found = "\n".join([*text, "", concluded, "", *kept]).rstrip() + "\n"
    path.write_text(found, encoding="utf-8")
    return found
