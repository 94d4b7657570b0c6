"""Figures of the sweep of speed against error: an error over the computing time."""

import math
from pathlib import Path

import matplotlib
import numpy as np

from bench.cases import CASES
from bench.cases.case import (
    ADAPTIVE,
    DFSPH,
    FIXED,
    UNIFORM,
    UNSHEARED,
    Case,
    Setting,
)
from bench.pareto_rows import high, low, number

matplotlib.use("Agg")
import matplotlib.pyplot as plt

# Smallest plotted error (-): smaller errors are rounding errors.
LEAST = 1e-7
# Colours (distinguishable by the colour-blind, Okabe and Ito 2008), markers and labels.
STYLES = {
    ("projection", UNIFORM): ("#0072B2", "o", "uniform"),
    ("projection", FIXED): ("#56B4E9", "s", "fixed layers"),
    ("projection", ADAPTIVE): ("#D55E00", "D", "adaptive layers"),
    ("classic", UNIFORM): ("#999999", "v", "classic, uniform"),
    ("classic", FIXED): ("#555555", "^", "classic, layers"),
    (DFSPH, UNIFORM): ("#CC79A7", "X", "SPlisHSPlasH, DFSPH"),
}
# Changes of rows without shear relief, in words.
WITHOUT_RELIEF = Setting(**UNSHEARED).changes
OTHER = ("#009E73", "P")


def undominated(rows: list[dict], error: str) -> list[dict]:
    """Returns the rows to which no other row is superior in both time and error, fastest first."""
    found: list[dict] = []
    for row in sorted(rows, key=lambda r: number(r, "wall_per_simulated")):
        if not found or number(row, error) < number(found[-1], error):
            found.append(row)
    return found


def drawn(rows: list[dict], case: Case, error: str = "") -> list[dict]:
    """Returns the rows of the case with a time and a value of `error` (default: the main error)."""
    return [
        row
        for row in rows
        if row["case"] == case.name
        and all(np.isfinite(number(row, k)) for k in ("wall_per_simulated", error or case.main))
    ]


def plot(axis, rows: list[dict], case: Case, error: str) -> None:
    """Plots an error over time: medians and ranges over the starts."""
    rows = drawn(rows, case, error)
    for row in rows:
        kind = (row["method"], row["water"])
        colour, marker, _ = STYLES.get(kind, (*OTHER, ""))
        x, y = number(row, "wall_per_simulated"), max(number(row, error), LEAST)
        ends = [max(end(row, error), LEAST) for end in (low, high)]
        axis.plot([x, x], ends, color=colour, lw=0.8, alpha=0.6, zorder=2)
        size, edge = 25 if row["changes"] else 60, "white"
        if row["changes"] == WITHOUT_RELIEF:
            size, edge = 40, "black"
        axis.scatter(x, y, size, colour, marker, edgecolors=edge, linewidths=0.8, zorder=3)
        if kind not in STYLES:
            label = f"{row['water']}, {row['method']}"
            axis.annotate(label, (x, y), (5, 3), textcoords="offset points", fontsize=8)
    best = undominated(rows, error)
    x = [number(row, "wall_per_simulated") for row in best]
    axis.plot(x, [max(number(row, error), LEAST) for row in best], color="#000000", lw=0.8)
    axis.set(xscale="log", yscale="log", title=case.title)
    for ticks, format_ in ((axis.yaxis, "{:g} %"), (axis.xaxis, "{:g}")):
        label_ticks(ticks, format_, 100.0 if "%" in format_ else 1.0)
    axis.set_xlabel("elapsed seconds per simulated second")
    axis.set_ylabel(error.replace("_", " ") + " error")
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
    axis.scatter([], [], 40, "white", edgecolors="black", label="black edge: no shear relief")
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
            plot(axis, own, case, case.main)
            legend(axis)
            names.append(save(figure, folder, f"pareto_{case.name}"))
    panels = [(c, error) for c in CASES.values() for error in c.summary if drawn(rows, c, error)]
    if panels:
        down = math.ceil(len(panels) / 2)
        figure, grid = plt.subplots(down, 2, figsize=(11.0, 4.4 * down), squeeze=False)
        for axis, (case, error) in zip(grid.flat, panels, strict=False):
            plot(axis, rows, case, error)
            shift = f", {case.note}" if error == case.main and case.note else ""
            axis.set_title(f"{case.title}{shift}", fontsize=10)
        for axis in grid.flat[len(panels) :]:
            axis.set_axis_off()
        legend(grid.flat[-1])
        save(figure, folder, "pareto")
    return names


def save(figure, folder: Path, name: str) -> str:
    figure.tight_layout()
    figure.savefig(folder / f"{name}.png", dpi=100)
    plt.close(figure)
    return name
