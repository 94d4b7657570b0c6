"""Tables and figures of the sweep of speed against error, from its rows alone."""

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

# Errors below are drawn there: what is left is rounding.
LEAST = 1e-7
# Errors asked of the recommended settings (-).
ASKED = (0.3, 0.1, 0.03, 0.01, 0.003)
# How waters are drawn: colours that the colour-blind tell apart (Okabe and Ito 2008), and markers.
STYLES = {
    ("projection", UNIFORM): ("#0072B2", "o", "uniform"),
    ("projection", FIXED): ("#56B4E9", "s", "fixed layers"),
    ("projection", ADAPTIVE): ("#D55E00", "D", "adaptive layers"),
    ("classic", UNIFORM): ("#999999", "v", "classic, uniform"),
    ("classic", FIXED): ("#555555", "^", "classic, layers"),
}
# What rows with shear relief change, in words.
RELIEVED = Setting(shear_relief=RELIEF).changes
OTHER = ("#009E73", "P")
COSTS = {
    "wall_per_simulated": "wall-clock s / simulated s",
    "particles": "particles",
    "peak_mib": "peak MiB",
    "compression_mean": "compression, mean",
    "compression_largest": "largest",
}


def changes(row: dict) -> str:
    """What a row's setting changes, in words."""
    found = [f"{text} {float(row[k]):g}" for k, text in CHANGEABLE.items() if row.get(k)]
    return ", ".join(found)


def undominated(rows: list[dict], error: str) -> list[dict]:
    """Rows for which no other is both faster and nearer, from fast to slow."""
    found: list[dict] = []
    for row in sorted(rows, key=lambda r: number(r, "wall_per_simulated")):
        if not found or number(row, error) < number(found[-1], error):
            found.append(row)
    return found


def drawn(rows: list[dict], case: Case) -> list[dict]:
    """Rows of the case that have a time and its first error."""
    return [
        row
        for row in rows
        if row["case"] == case.name
        and all(np.isfinite(number(row, k)) for k in ("wall_per_simulated", case.main))
    ]


def plot(axis, rows: list[dict], case: Case) -> None:
    """Time across, error up."""
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
    axis.set_xlabel("wall-clock seconds per simulated second")
    axis.set_ylabel(case.main.replace("_", " ") + " error")
    axis.axvline(1.0, color="#bbbbbb", lw=0.8, ls=":")
    axis.spines[["top", "right"]].set_visible(False)


def label_ticks(ticks, format_: str, scale: float) -> None:
    """Numbers in place of powers; within few decades at 2 and 5, too."""
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
    """One for each case that has rows, and one of several; returns the names."""
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
    """Rows of projection, for each water."""
    return {
        w: [r for r in rows if (r["method"], r["water"]) == ("projection", w)] for w in STYLES_OF
    }


def unreached(rows: list[dict], case: Case) -> str:
    """The case's first error where a run in adaptive layers is nearer than any uniform one, though
    some took longer, in words."""
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
        f"no uniform run, of up to {longest:.3g} s per s, is as near as adaptive layers in "
        f"{time:.3g}: {case.main.replace('_', ' ')} {shown('error', best)}, not "
        f"{shown('error', error)}"
    )


def ratio_at_equal_error(rows: list[dict], case: Case) -> str:
    """How many times as long uniform water takes as adaptive layers at the same error, in words."""
    found = {error: _ratio(rows, error) for error in case.errors}
    told = [
        f"{name.replace('_', ' ')} {'over ' * bound}{ratio:.2g}"
        for name, (ratio, bound) in found.items()
        if ratio
    ]
    if not told:
        return "no uniform run has the errors of one in adaptive layers"
    times = ", ".join(told)
    return f"at equal error uniform water takes up to so many times as long as adaptive: {times}"


def _ratio(rows: list[dict], error: str) -> tuple[float, bool]:
    """The most of all adaptive rows, 0 where none has an error that uniform ones reach, and whether
    it is a bound, since no uniform row is as near; uniform rows between which an error lies are
    joined in logarithms."""
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
    """Order of convergence: how fast errors fall with the spacing, and its standard error."""
    if len(errors) < 3 or not np.isfinite(errors).all():
        return "-"
    fit = linregress(-np.log(fineness), np.log(np.maximum(errors, LEAST)))
    return f"{fit.slope:.1f} +- {fit.stderr:.1f}"


def orders(rows: list[dict], case: Case) -> list[dict[str, str]]:
    """A row for each water of projection: the order in which each error falls with the spacing."""
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
            found.append({"water": water, "changed": change, **by})
    return found


def recommended(rows: list[dict]) -> list[dict[str, str]]:
    """A line for each run that is the cheapest to keep some error asked of its case."""
    lines: dict[int, dict[str, str]] = {}
    for case in CASES.values():
        for asked in ASKED:
            good = [r for r in drawn(rows, case) if number(r, case.main) <= asked]
            if good:
                best = min(good, key=lambda r: number(r, "wall_per_simulated"))
                error = shown("error", number(best, case.main))
                # A run that keeps a smaller error, too, is listed with that one.
                lines[id(best)] = {
                    "case": case.title,
                    "asked": f"{case.main.replace('_', ' ')} within {100.0 * asked:g} %",
                    "cheapest": f"{best['method']}, {best['water']}",
                    "fineness": best["fineness"],
                    "changed": changes(best),
                    "error": error,
                    "s per s": shown("wall_per_simulated", number(best, "wall_per_simulated")),
                }
    return list(lines.values())


def self_convergence(rows: list[dict], case: Case) -> list[dict[str, str]]:
    """Differences of the case's values from those of the finest uniform run, and their order."""
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
    """A line a row, from fast to slow, as Markdown; undominated ones in bold."""
    best = [id(row) for row in undominated(drawn(rows, case), case.main)]
    lines = []
    for row in sorted((r for r in rows if r["case"] == case.name), key=order):
        mark = "**" if id(row) in best else ""
        cells = {"method": row["method"], "water": f"{mark}{row['water']}{mark}"}
        cells |= {"fineness": row["fineness"], "changed": changes(row)}
        for name, head in COSTS.items():
            cells[head] = shown(name, number(row, name))
        for name in case.errors:
            cells[name.replace("_", " ")] = shown("error", number(row, name))
        if disturbed(row):
            cells["changed"] += f" (beside {number(row, 'others'):.1f} busy cores)"
        if row.get("failure"):
            cells["changed"] += f" failed: {row['failure']}"
        lines.append(cells)
    return lines_of(lines)


def lines_of(rows: list[dict[str, str]]) -> str:
    """As a table in Markdown."""
    return tabulate(rows, headers="keys", tablefmt="github", disable_numparse=True)


def order(row: dict) -> tuple[bool, float]:
    time = number(row, "wall_per_simulated")
    return math.isnan(time), time


def shown(name: str, value: float) -> str:
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
        "Wall-clock seconds per simulated second, of frames of 1/60 s; the process's largest "
        "resident size, 150 MiB of which\nis Python and Taichi; compression: max(rho/rho0 - 1, 0), "
        "rho summed over positions at the end of frames. Bold: no other\nrow is both faster and "
        "nearer, by the case's first error. Every row is one run, or as many starts as its error "
        "says.\n",
    ]
    figures(rows, folder)
    text += ["## The cheapest run at an error\n", f"{lines_of(recommended(rows))}\n"]
    for case in CASES.values():
        own = [row for row in rows if row["case"] == case.name]
        if not own:
            continue
        text += [
            f"## {case.title}\n",
            f"Fineness: spacings of the finest particles over {case.across}.\n",
        ]
        text += [f"- {name.replace('_', ' ')}: {what}" for name, what in case.errors.items()]
        if {UNIFORM, ADAPTIVE} <= {row["water"] for row in own}:
            told = (f(drawn(rows, case), case) for f in (ratio_at_equal_error, unreached))
            text += [f"\n{words[0].upper()}{words[1:]}." for words in told if words]
        text += ["", table(rows, case), ""]
        for title, found in (
            (
                "Order in which errors fall with the spacing, and its standard error:",
                orders(own, case),
            ),
            ("Differences from the finest uniform run:", self_convergence(rows, case)),
        ):
            if found:
                text += [title, "", tabulate(found, headers="keys", tablefmt="github"), ""]
        if drawn(rows, case):
            text.append(f"![{case.title}](pareto_{case.name}.png)\n")
    (folder / "pareto.md").write_text("\n".join(text), encoding="utf-8")
