"""Tables and figures of the sweep of speed against error, generated from its rows."""

import itertools
import math
import sys
from pathlib import Path

import matplotlib
import numpy as np
from scipy.stats import linregress
from tabulate import tabulate

from bench.cases import CASES
from bench.cases.case import (
    ADAPTIVE,
    CHANGEABLE,
    FIXED,
    RELIEF,
    UNIFORM,
    Case,
    Setting,
)
from bench.pareto_table import disturbed, number
from bench.report import RESULTS

matplotlib.use("Agg")
import matplotlib.pyplot as plt

# Smallest plotted error (-): smaller ones are rounding.
LEAST = 1e-7
# Error limits for which the fastest run is listed (-).
LIMITS = (0.3, 0.1, 0.03, 0.01, 0.003)
# Colours (distinguishable by the colour-blind, Okabe and Ito 2008), markers and labels.
STYLES = {
    ("projection", UNIFORM): ("#0072B2", "o", "uniform"),
    ("projection", FIXED): ("#56B4E9", "s", "fixed layers"),
    ("projection", ADAPTIVE): ("#D55E00", "D", "adaptive layers"),
    ("classic", UNIFORM): ("#999999", "v", "classic, uniform"),
    ("classic", FIXED): ("#555555", "^", "classic, layers"),
}
# Changes of rows with shear relief, in words.
RELIEVED = Setting(shear_relief=RELIEF).changes
OTHER = ("#009E73", "P")
COSTS = {
    "wall_per_simulated": "elapsed s / simulated s",
    "particles": "particles",
    "peak_mib": "peak MiB",
    "compression_mean": "compression, mean",
    "compression_largest": "largest",
}


def changes(row: dict) -> str:
    """Returns the changes of a row's setting, in words."""
    found = [f"{text} {float(row[k]):g}" for k, text in CHANGEABLE.items() if row.get(k)]
    return ", ".join(found)


def undominated(rows: list[dict], error: str) -> list[dict]:
    """Returns the rows to which no other row is superior in both time and error, fastest first."""
    found: list[dict] = []
    for row in sorted(rows, key=lambda r: number(r, "wall_per_simulated")):
        if not found or number(row, error) < number(found[-1], error):
            found.append(row)
    return found


def drawn(rows: list[dict], case: Case) -> list[dict]:
    """Returns the rows of the case with a time and a value of its main error."""
    return [
        row
        for row in rows
        if row["case"] == case.name
        and all(np.isfinite(number(row, k)) for k in ("wall_per_simulated", case.main))
    ]


def plot(axis, rows: list[dict], case: Case) -> None:
    """Plots the main error over time."""
    for row in rows:
        kind = (row["method"], row["water"])
        colour, marker, _ = STYLES.get(kind, (*OTHER, ""))
        x, y = number(row, "wall_per_simulated"), max(number(row, case.main), LEAST)
        size, edge = 25 if changes(row) else 60, "white"
        if changes(row) == RELIEVED:
            size, edge = 40, "black"
        axis.scatter(x, y, size, colour, marker, edgecolors=edge, linewidths=0.8, zorder=3)
        if kind not in STYLES:
            label = f"{row['water']}, {row['method']}"
            axis.annotate(label, (x, y), (5, 3), textcoords="offset points", fontsize=8)
    best = undominated(rows, case.main)
    x = [number(row, "wall_per_simulated") for row in best]
    axis.plot(x, [max(number(row, case.main), LEAST) for row in best], color="#000000", lw=0.8)
    axis.set(xscale="log", yscale="log", title=case.title)
    for ticks, format_ in ((axis.yaxis, "{:g} %"), (axis.xaxis, "{:g}")):
        label_ticks(ticks, format_, 100.0 if "%" in format_ else 1.0)
    axis.set_xlabel("elapsed seconds per simulated second")
    axis.set_ylabel(case.main.replace("_", " ") + " error")
    axis.axvline(1.0, color="#bbbbbb", lw=0.8, ls=":")
    axis.spines[["top", "right"]].set_visible(False)


def label_ticks(ticks, format_: str, scale: float) -> None:
    """Labels ticks by numbers without powers of ten; on short axes also at 2 and 5."""
    low, high = ticks.get_view_interval()
    few = math.log10(high / low) < 2.5
    ticks.set_major_formatter(lambda value, _: format_.format(float(f"{scale * value:.3g}")))

    def between(value: float, _: int) -> str:
        digit = round(value / 10.0 ** math.floor(math.log10(value)))
        return format_.format(float(f"{scale * value:.3g}")) if few and digit in (2, 5) else ""

    ticks.set_minor_formatter(between)


def legend(axis) -> None:
    for colour, marker, label in STYLES.values():
        axis.scatter([], [], 60, colour, marker, label=label)
    axis.scatter([], [], 40, "white", edgecolors="black", label="black edge: shear relief")
    axis.scatter([], [], 25, "#000000", label="small: another setting")
    axis.plot([], [], color="#000000", lw=0.8, label="undominated")
    axis.legend(fontsize=8, framealpha=0.9)


def figures(rows: list[dict], folder: Path) -> list[str]:
    """Writes a figure for each case with rows and a summary; returns the names."""
    names = []
    for case in CASES.values():
        own = drawn(rows, case)
        if own:
            figure, axis = plt.subplots(figsize=(7.5, 5.0))
            plot(axis, own, case)
            legend(axis)
            names.append(save(figure, folder, f"pareto_{case.name}"))
    summary = [case for case in CASES.values() if case.summary and drawn(rows, case)]
    if summary:
        down = math.ceil(len(summary) / 2)
        figure, grid = plt.subplots(down, 2, figsize=(11.0, 4.4 * down), squeeze=False)
        for axis, case in zip(grid.flat, summary, strict=False):
            plot(axis, drawn(rows, case), case)
            axis.set_title(case.title, fontsize=10)
        for axis in grid.flat[len(summary) :]:
            axis.set_axis_off()
        legend(grid.flat[-1])
        save(figure, folder, "pareto")
    return names


def save(figure, folder: Path, name: str) -> str:
    figure.tight_layout()
    figure.savefig(folder / f"{name}.png", dpi=100)
    plt.close(figure)
    return name


def by_water(rows: list[dict]) -> dict[str, list[dict]]:
    """Returns the rows of the projection method by kind of water."""
    return {
        w: [r for r in rows if (r["method"], r["water"]) == ("projection", w)] for w in STYLES_OF
    }


def unreached(rows: list[dict], case: Case) -> str:
    """Returns a sentence if a run with adaptive layers has a smaller main error than all uniform
    runs, some of which took longer; else ""."""
    by = by_water(rows)
    longest = max((number(r, "wall_per_simulated") for r in by[UNIFORM]), default=0.0)
    best = min((number(r, case.main) for r in by[UNIFORM]), default=0.0)
    nearer = [
        (number(r, "wall_per_simulated"), number(r, case.main))
        for r in by[ADAPTIVE]
        if LEAST < number(r, case.main) < best and number(r, "wall_per_simulated") < longest
    ]
    if not nearer:
        return ""
    time, error = min(nearer)
    return (
        f"uniform runs of up to {longest:.3g} s per s do not reach the error of adaptive layers in "
        f"{time:.3g}: {case.main.replace('_', ' ')} {shown('error', best)}, not "
        f"{shown('error', error)}"
    )


def ratio_at_equal_error(rows: list[dict], case: Case) -> str:
    """Returns the largest speed-up of adaptive layers over uniform water at equal error, in
    words."""
    found = {error: _ratio(rows, error) for error in case.errors}
    parts = [
        f"{name.replace('_', ' ')} {'over ' * bound}{ratio:.2g}"
        for name, (ratio, bound) in found.items()
        if ratio
    ]
    if not parts:
        return "no uniform run has an error of a run with adaptive layers"
    factors = ", ".join(parts)
    text = "at equal error adaptive layers are faster than uniform water by a factor of up to"
    return f"{text}: {factors}"


def _ratio(rows: list[dict], error: str) -> tuple[float, bool]:
    """Returns the largest ratio of times over all adaptive rows, 0 if no uniform row has such an
    error, and whether the ratio is a lower bound, as no uniform row reaches the error. Times are
    interpolated in logarithms between uniform rows."""
    by = by_water(rows)
    uniform = undominated(by[UNIFORM], error)
    errors = np.log([max(number(r, error), LEAST) for r in uniform])
    time = np.log([number(r, "wall_per_simulated") for r in uniform])
    best, bound = 0.0, False
    for row in by[ADAPTIVE]:
        wanted = math.log(max(number(row, error), LEAST))
        if wanted > math.log(LEAST) and len(errors) and wanted <= errors.max():
            at = np.interp(-wanted, -errors, time)
            found = math.exp(at) / number(row, "wall_per_simulated")
            if found > best:
                best, bound = found, wanted < errors.min()
    return best, bound


STYLES_OF = (UNIFORM, FIXED, ADAPTIVE)


def slope(fineness: list[float], errors: list[float]) -> str:
    """Returns the order of convergence with the spacing, and its standard error."""
    if len(errors) < 3 or not np.isfinite(errors).all():
        return "-"
    fit = linregress(-np.log(fineness), np.log(np.maximum(errors, LEAST)))
    return f"{fit.slope:.1f} +- {fit.stderr:.1f}"


def orders(rows: list[dict], case: Case) -> list[dict[str, str]]:
    """Returns a row for each kind of water: order of convergence of each error."""
    found = []
    for change, water in itertools.product(("", RELIEVED), STYLES_OF):
        own = [
            r
            for r in rows
            if (r["method"], r["water"], changes(r)) == ("projection", water, change)
        ]
        own.sort(key=lambda r: float(r["fineness"]))
        if len(own) > 2:
            fineness = [float(r["fineness"]) for r in own]
            by = {e: slope(fineness, [number(r, e) for r in own]) for e in case.errors}
            found.append({"water": water, "changes": change, **by})
    return found


def recommended(rows: list[dict]) -> list[dict[str, str]]:
    """Returns a row for each run that is the fastest within an error limit of its case."""
    lines: dict[int, dict[str, str]] = {}
    for case in CASES.values():
        for limit in LIMITS:
            good = [r for r in drawn(rows, case) if number(r, case.main) <= limit]
            if good:
                best = min(good, key=lambda r: number(r, "wall_per_simulated"))
                error = shown("error", number(best, case.main))
                # A run that is the fastest for several limits is listed with the smallest.
                lines[id(best)] = {
                    "case": case.title,
                    "limit": f"{case.main.replace('_', ' ')} within {100.0 * limit:g} %",
                    "fastest": f"{best['method']}, {best['water']}",
                    "fineness": best["fineness"],
                    "changes": changes(best),
                    "error": error,
                    "s per s": shown("wall_per_simulated", number(best, "wall_per_simulated")),
                }
    return list(lines.values())


def self_convergence(rows: list[dict], case: Case) -> list[dict[str, str]]:
    """Returns the differences of the case's values from the finest uniform run, and their order."""
    own = [
        r
        for r in rows
        if r["case"] == case.name
        and r["method"] == "projection"
        and not changes(r)
        and np.isfinite(number(r, (case.values or ("",))[0]))
    ]
    uniform = sorted((r for r in own if r["water"] == UNIFORM), key=lambda r: float(r["fineness"]))
    if len(uniform) < 3:
        return []
    finest, found = uniform[-1], []
    for name in case.values:
        exact, row = number(finest, name), {"value": name, "finest": f"{number(finest, name):.4g}"}
        for water in STYLES_OF:
            same = [r for r in own if r["water"] == water and r is not finest]
            same.sort(key=lambda r: float(r["fineness"]))
            apart = [abs(number(r, name) - exact) for r in same]
            for r, difference in zip(same, apart, strict=True):
                row[f"{water} {r['fineness']}"] = f"{difference:.2g}"
            row[f"{water}, order"] = slope([float(r["fineness"]) for r in same], apart)
        found.append(row)
    return found


def table(rows: list[dict], case: Case) -> str:
    """Returns the case's rows as a Markdown table, fastest first, undominated ones in bold."""
    best = [id(row) for row in undominated(drawn(rows, case), case.main)]
    lines = []
    for row in sorted((r for r in rows if r["case"] == case.name), key=order):
        mark = "**" if id(row) in best else ""
        cells = {"method": row["method"], "water": f"{mark}{row['water']}{mark}"}
        cells |= {"fineness": row["fineness"], "changes": changes(row)}
        for name, head in COSTS.items():
            cells[head] = shown(name, number(row, name))
        for name in case.errors:
            cells[name.replace("_", " ")] = shown("error", number(row, name))
        if disturbed(row):
            cells["changes"] += f" ({number(row, 'others'):.1f} cores busy with other work)"
        if row.get("failure"):
            cells["changes"] += f" failed: {row['failure']}"
        lines.append(cells)
    return lines_of(lines)


def lines_of(rows: list[dict[str, str]]) -> str:
    """Returns rows as a Markdown table."""
    return tabulate(rows, headers="keys", tablefmt="github", disable_numparse=True)


def order(row: dict) -> tuple[bool, float]:
    """Returns the sort key of a row: its time, rows without a time last."""
    time = number(row, "wall_per_simulated")
    return math.isnan(time), time


def shown(name: str, value: float) -> str:
    """Formats a figure of a row."""
    if math.isnan(value):
        return "-"
    if name in ("particles", "peak_mib"):
        return f"{value:,.0f}"
    if name == "wall_per_simulated":
        return f"{value:.3g}"
    return f"{100.0 * value:.3f} %" if value >= 1e-5 else f"{value:.0e}"


def report(rows: list[dict], folder: Path = RESULTS) -> None:
    """Writes pareto.md and the figures."""
    where = sorted({f"{r['machine']}; arch {r['arch']}; {r['date']}" for r in rows})
    command = " ".join(["python", *sys.argv])
    text = [
        "# Speed against error\n",
        *(f"- {place}" for place in where),
        f"- drawn by `{command}`\n",
        "Elapsed seconds per simulated second, in frames of 1/60 s; peak memory of the process, "
        "150 MiB of which is Python and\nTaichi; compression: max(rho/rho0 - 1, 0), rho computed "
        "from the positions at the end of frames. Bold: no other row is\nfaster and has a smaller "
        "main error, the first of the case's list. Every row is one run, unless its error states "
        "more.\n",
    ]
    figures(rows, folder)
    text += ["## The fastest run within an error limit\n", f"{lines_of(recommended(rows))}\n"]
    for case in CASES.values():
        own = [row for row in rows if row["case"] == case.name]
        if not own:
            continue
        text += [
            f"## {case.title}\n",
            f"Fineness: {case.across} in finest spacings.\n",
        ]
        text += [f"- {name.replace('_', ' ')}: {what}" for name, what in case.errors.items()]
        if {UNIFORM, ADAPTIVE} <= {row["water"] for row in own}:
            found = (f(drawn(rows, case), case) for f in (ratio_at_equal_error, unreached))
            text += [f"\n{words[0].upper()}{words[1:]}." for words in found if words]
        text += ["", table(rows, case), ""]
        for title, lines in (
            (
                "Order of convergence with the spacing, and its standard error:",
                orders(own, case),
            ),
            ("Differences from the finest uniform run:", self_convergence(rows, case)),
        ):
            if lines:
                text += [title, "", tabulate(lines, headers="keys", tablefmt="github"), ""]
        if drawn(rows, case):
            text.append(f"![{case.title}](pareto_{case.name}.png)\n")
    (folder / "pareto.md").write_text("\n".join(text), encoding="utf-8")
