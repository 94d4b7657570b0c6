"""Figures of the sweep of speed against error: an error over the computing time."""

import math
from pathlib import Path
from statistics import median

import matplotlib

from bench.cases import CASES
from bench.cases.case import ADAPTIVE, DFSPH, FIXED, UNIFORM, UNSHEARED, Case, Setting
from bench.pareto_rows import TIME, Pick, Result

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


def undominated(results: list[Result], error: str, pick: Pick = median) -> list[Result]:
    """Returns the results to which no other one is superior in both time and error, fastest
    first."""
    found: list[Result] = []
    for result in sorted(results, key=lambda r: r.of(TIME, pick)):
        if not found or result.of(error, pick) < found[-1].of(error, pick):
            found.append(result)
    return found


def drawn(results: list[Result], case: Case, error: str = "") -> list[Result]:
    """Returns the results of the case with a time and an `error` (default: the main error)."""
    return [
        r
        for r in results
        if r.case == case.name and math.isfinite(r.time) and math.isfinite(r.of(error or case.main))
    ]


def plot(axis, results: list[Result], case: Case, error: str) -> None:
    """Plots an error over time: medians and ranges over the starts."""
    results = drawn(results, case, error)
    for result in results:
        kind = (result.method, result.water)
        colour, marker, _ = STYLES.get(kind, (*OTHER, ""))
        low, y, high = (max(result.of(error, pick), LEAST) for pick in (min, median, max))
        axis.plot([result.time] * 2, [low, high], color=colour, lw=0.8, alpha=0.6, zorder=2)
        size, edge = 25 if result.changes else 60, "white"
        if result.changes == WITHOUT_RELIEF:
            size, edge = 40, "black"
        place = result.time, y
        axis.scatter(*place, size, colour, marker, edgecolors=edge, linewidths=0.8, zorder=3)
        if kind not in STYLES:
            label = f"{result.water}, {result.method}"
            axis.annotate(label, place, (5, 3), textcoords="offset points", fontsize=8)
    best = undominated(results, error)
    errors = [max(r.of(error), LEAST) for r in best]
    axis.plot([r.time for r in best], errors, color="#000000", lw=0.8)
    axis.set(xscale="log", yscale="log", title=case.title)
    label_ticks(axis.yaxis, "{:g} %", 100.0)
    label_ticks(axis.xaxis, "{:g}", 1.0)
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


def figures(results: list[Result], folder: Path) -> None:
    """Writes a figure for each case with results, and a summary."""
    for case in CASES.values():
        own = drawn(results, case)
        if own:
            figure, axis = plt.subplots(figsize=(7.5, 5.0))
            plot(axis, own, case, case.main)
            legend(axis)
            save(figure, folder / f"pareto_{case.name}.png")
    panels = [(c, error) for c in CASES.values() for error in c.summary if drawn(results, c, error)]
    if panels:
        down = math.ceil(len(panels) / 2)
        figure, grid = plt.subplots(down, 2, figsize=(11.0, 4.4 * down), squeeze=False)
        for axis, (case, error) in zip(grid.flat, panels, strict=False):
            plot(axis, results, case, error)
            shift = f", {case.note}" if error == case.main and case.note else ""
            axis.set_title(f"{case.title}{shift}", fontsize=10)
        for axis in grid.flat[len(panels) :]:
            axis.set_axis_off()
        legend(grid.flat[-1])
        save(figure, folder / "pareto.png")


def save(figure, path: Path) -> None:
    figure.tight_layout()
    figure.savefig(path, dpi=100)
    plt.close(figure)
