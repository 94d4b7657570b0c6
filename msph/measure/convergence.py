"""Discretisation error: the same scene at several spacings, and what their differences tell.

A figure phi of runs with spacings h follows phi = phi_0 + a h^p once h is small enough; order p,
limit phi_0 and a come from three runs exactly, from more by least squares (Eca & Hoekstra 2008, the
grid convergence index of Roache; Celik et al. 2008 for three runs; ASME V&V 20). The estimated
error of the finest run is phi - phi_0. Its uncertainty is 1.25 times as much where p is between
.95 and 2.05, of a method of first to second order; for other orders at least 1.25 times the largest
difference among the runs; three times that where differences grow or swing, which tell no order.
"""

import csv
import itertools
import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from tabulate import tabulate

from msph.measure.table import energy_less_work, parts
from msph.own_files import replacing

# Ratio of the spacings of successive runs: Celik et al. ask for 1.3 at least; a coarser run costs
# a quarter of the next finer.
RATIO = math.sqrt(2.0)
# Orders of a method of first to second order, and the factor of safety within (Eca & Hoekstra
# 2008, appendix 1); and where no order is found.
ORDERS, SAFETY, SAFETY_UNKNOWN = (0.95, 2.05), 1.25, 3.0
# Orders among which the fit is sought: beyond, differences are either equal or all in one.
LEAST_ORDER, MOST_ORDER = 0.05, 12.0
# Part of the finest spacing that the centre of mass must move along an axis to be compared there.
MOVES = 0.1
# Differences below this share of the values are rounding.
SAME = 1e-7


@dataclass(frozen=True)
class Estimate:
    """What the values of one figure tell, in its unit: observed order (-), limit and error of the
    finest run, NaN where none can be told; uncertainty; and a verdict in words."""

    order: float
    limit: float
    error: float
    uncertainty: float
    verdict: str


@dataclass(frozen=True)
class Row:
    """A figure, its unit, its values from the coarsest run to the finest, and their estimate."""

    name: str
    unit: str
    values: list[float]
    estimate: Estimate


def factors(runs: int) -> list[float]:
    """Spacings of the runs over those of the scene (-), from coarse to the scene's own."""
    return [RATIO**k for k in reversed(range(runs))]


def estimate(values: Iterable[float], ratio: float = RATIO) -> Estimate:
    """Of at least three values from coarse to fine, spacings in the same ratio."""
    phi = np.array(list(values), float)
    nan = math.nan
    if not np.isfinite(phi).all():
        return Estimate(nan, nan, nan, nan, "not known in every run")
    differences, spread = np.diff(phi), float(np.ptp(phi))
    if spread <= SAME * np.abs(phi).max():
        return Estimate(nan, float(phi[-1]), 0.0, 0.0, "the same in all runs")
    why = ""
    if len(set(np.sign(differences))) > 1:
        why = "swing"
    elif abs(differences[-1]) >= abs(differences[-2]):
        why = "grow"
    if why:
        verdict = f"not in the asymptotic range: differences {why}"
        return Estimate(nan, nan, nan, SAFETY_UNKNOWN * spread, verdict)
    h = ratio ** np.arange(len(phi) - 1.0, -1.0, -1.0)
    order = _order(h, phi)
    limit = _fit(h, phi, order)[0]
    error = float(phi[-1] - limit)
    if ORDERS[0] <= order <= ORDERS[1]:
        return Estimate(order, limit, error, SAFETY * abs(error), "in the asymptotic range")
    pace = "slower than first" if order < ORDERS[0] else "faster than second"
    bound = SAFETY * max(abs(error), spread)
    verdict = f"not in the asymptotic range: {pace} order"
    return Estimate(order, limit, error, bound, verdict)


def _fit(h: np.ndarray, phi: np.ndarray, order: float) -> tuple[float, float]:
    """phi_0 and the sum of squares that phi_0 + a h^order leaves."""
    basis = np.column_stack([np.ones_like(h), h**order])
    found, *_ = np.linalg.lstsq(basis, phi, rcond=None)
    return float(found[0]), float(((basis @ found - phi) ** 2).sum())


def _order(h: np.ndarray, phi: np.ndarray) -> float:
    """The order that leaves least, best of a scan and refined."""
    # Here, since only this needs it, and it is slow to import.
    from scipy.optimize import minimize_scalar

    orders = np.linspace(LEAST_ORDER, MOST_ORDER, 240)
    left = [_fit(h, phi, p)[1] for p in orders]
    k = int(np.argmin(left))
    ends = orders[max(k - 1, 0)], orders[min(k + 1, len(orders) - 1)]
    options = {"xatol": 1e-9}
    found = minimize_scalar(
        lambda p: _fit(h, phi, p)[1], bounds=ends, method="bounded", options=options
    )
    return float(found.x)


def _mean(values: np.ndarray) -> float:
    """Of what is known; NaN where nothing is."""
    return float(np.nanmean(values)) if np.isfinite(values).any() else math.nan


def compare(ledgers: list[dict], probes: list[dict], spacing: float) -> list[Row]:
    """Rows for tables of runs from coarse to fine (see table.read); spacing [m]: the finest.

    Means over the run, which are smoother than values at one time, of the centre of mass where it
    moves, kinetic energy and every probe; the mechanical energy lost by the end; and the distance
    of the centre's path from that of the next finer run, root mean square over time.
    """
    paths = [np.column_stack([t[f"centre_{k}_m"] for k in "xyz"]) for t in ledgers]
    moves = np.abs(paths[-1] - paths[-1][0]).max(axis=0) > MOVES * spacing
    rows = [
        _row(f"centre_{k}_mean", "m", [path[:, i].mean() for path in paths])
        for i, k in enumerate("xyz")
        if moves[i]
    ]
    rows.append(_row("kinetic_mean", "J", [t["kinetic_J"].mean() for t in ledgers]))
    rows.append(_row("energy_lost", "J", [_lost(t) for t in ledgers]))
    for name in (n for n in probes[-1] if n != "time_s"):
        means = [_mean(t[name]) if name in t else math.nan for t in probes]
        head, unit = parts(name)
        rows.append(_row(f"{head}_mean", unit, means))
    n = min(map(len, paths))
    steps = [
        float(np.sqrt(((a[:n] - b[:n]) ** 2).sum(axis=1).mean()))
        for a, b in itertools.pairwise(paths)
    ]
    rows.append(Row("path_to_next_finer", "m", [*steps, math.nan], _of_steps(steps)))
    return rows


def _row(name: str, unit: str, values: list) -> Row:
    values = [float(v) for v in values]
    return Row(name, unit, values, estimate(values))


def _lost(ledger: dict) -> float:
    """Mechanical energy lost by the end [J], what was given from outside counted."""
    energy = energy_less_work(ledger)
    return float(energy[0] - energy[-1])


def _of_steps(steps: list[float]) -> Estimate:
    """Of the distances between successive runs, all positive: they shrink by ratio^order, and the
    finest run's to the limit is the rest of the geometric series."""
    nan, (before, last) = math.nan, steps[-2:]
    if last == 0.0:
        return Estimate(nan, nan, 0.0, 0.0, "the same in all runs")
    if last >= before:
        verdict = "not in the asymptotic range: differences grow"
        return Estimate(nan, nan, nan, SAFETY_UNKNOWN * max(steps), verdict)
    order = math.log(before / last) / math.log(RATIO)
    error = last / (RATIO**order - 1.0)
    if ORDERS[0] <= order <= ORDERS[1]:
        return Estimate(order, nan, error, SAFETY * error, "in the asymptotic range")
    pace = "slower than first" if order < ORDERS[0] else "faster than second"
    verdict = f"not in the asymptotic range: {pace} order"
    return Estimate(order, nan, error, SAFETY * max(error, *steps), verdict)


ESTIMATE = ["order", "limit", "error", "uncertainty", "verdict"]


def _cells(row: Row, digits: int, unknown: str) -> list[str]:
    e = row.estimate
    numbers = [*row.values, e.order, e.limit, e.error, e.uncertainty]
    shown = (unknown if math.isnan(v) else f"{v:.{digits}g}" for v in numbers)
    return [row.name, row.unit, *shown, e.verdict]


def write(path: Path, rows: list[Row], spacings: list[float]) -> None:
    """convergence.csv: a line for each figure, in its unit, run_1 the coarsest; and one for the
    finest spacings [m] of the runs."""
    heads = ["quantity", "unit", *(f"run_{k + 1}" for k in range(len(spacings))), *ESTIMATE]
    first = ["finest_spacing", "m", *(f"{d:.6g}" for d in spacings), *[""] * len(ESTIMATE)]
    cells = [_cells(row, 6, "") for row in rows]
    with replacing(path) as new, open(new, "w", newline="", encoding="utf-8") as file:
        csv.writer(file, lineterminator="\n").writerows([heads, first, *cells])


def text(rows: list[Row], spacings: list[float]) -> str:
    """The table as it is printed, and what it amounts to."""
    heads = ["", "", *(f"{1e3 * d:.3g} mm" for d in spacings), *ESTIMATE]
    shown = [_cells(row, 4, "-") for row in rows]
    told = sum(r.estimate.verdict == "in the asymptotic range" for r in rows)
    verdict = f"{told} of {len(rows)} figures are in the asymptotic range"
    if told < len(rows):
        verdict += "; for the others take the uncertainty, or begin with smaller spacings"
    printed = tabulate(shown, headers=heads, tablefmt="plain", disable_numparse=True)
    return f"{printed}\n{verdict}"


def as_json(rows: list[Row]) -> list[dict]:
    """For the summary of the finest run."""
    return [
        {
            "quantity": row.name,
            "unit": row.unit,
            "value": row.values[-1],
            "order": row.estimate.order,
            "error": row.estimate.error,
            "uncertainty": row.estimate.uncertainty,
            "verdict": row.estimate.verdict,
        }
        for row in rows
    ]
