"""Convergence study: discretisation error from runs of the same scene at several spacings.

A figure phi of runs with spacings h follows phi = phi_0 + a h^p for small h; order p, limit phi_0
and a follow from three runs exactly, from more by least squares (Eca and Hoekstra 2008, the grid
convergence index of Roache; Celik et al. 2008 for three runs; ASME V&V 20). The estimated error of
the finest run is phi - phi_0. Its uncertainty is 1.25 times the error for 0.95 <= p <= 2.05, at
least 1.25 times the largest difference between runs for other orders, and three times the largest
difference if differences grow or oscillate, so that no order can be found.
"""

import csv
import itertools
import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from tabulate import tabulate

from msph.measure.entry import energy_less_work
from msph.measure.table import parts
from msph.own_files import replacing

# Ratio of the spacings of successive runs, at least 1.3 (Celik et al. 2008). A run costs a quarter
# of the next finer run.
RATIO = math.sqrt(2.0)
# Orders that count as asymptotic, and safety factors with and without a known order (Eca and
# Hoekstra 2008, appendix 1).
ORDERS, SAFETY, SAFETY_UNKNOWN = (0.95, 2.05), 1.25, 3.0
# Range of orders of the fit.
MIN_ORDER, MAX_ORDER = 0.05, 12.0
# Least displacement of the centre of mass along a compared axis, in finest spacings.
MIN_CENTRE_MOTION = 0.1
# Largest difference that counts as rounding, as a share of the values.
ROUNDING = 1e-7
ASYMPTOTIC = "in the asymptotic range"


@dataclass(frozen=True)
class Estimate:
    """Estimate for one figure, in its unit: a verdict in words, observed order (-), limit, error
    and uncertainty of the finest run, NaN if unknown."""

    verdict: str
    order: float = math.nan
    limit: float = math.nan
    error: float = math.nan
    uncertainty: float = math.nan


SAME = Estimate("the same in all runs", error=0.0, uncertainty=0.0)


@dataclass(frozen=True)
class Convergence:
    """A figure: name, unit, values from the coarsest run to the finest, and estimate."""

    name: str
    unit: str
    values: list[float]
    estimate: Estimate


def factors(runs: int) -> list[float]:
    """Returns the ratio of each run's spacings to the scene's (-), from coarse to 1."""
    return [RATIO**k for k in reversed(range(runs))]


def estimate(values: Iterable[float]) -> Estimate:
    """Returns the estimate from at least three values, from coarse to fine, at spacings that differ
    by RATIO."""
    phi = np.array(list(values), float)
    if not np.isfinite(phi).all():
        return Estimate("unknown in some runs")
    differences, spread = np.diff(phi), float(np.ptp(phi))
    if spread <= ROUNDING * np.abs(phi).max():
        return replace(SAME, limit=float(phi[-1]))
    if len(set(np.sign(differences))) > 1:
        return _without_order("oscillate", spread)
    if abs(differences[-1]) >= abs(differences[-2]):
        return _without_order("grow", spread)
    h = RATIO ** np.arange(len(phi) - 1.0, -1.0, -1.0)
    order = _order(h, phi)
    limit = _fit(h, phi, order)[0]
    return _with_order(order, limit, float(phi[-1] - limit), spread)


def _without_order(why: str, spread: float) -> Estimate:
    """Returns the estimate if differences grow or oscillate; spread: largest one between runs."""
    return Estimate(f"not {ASYMPTOTIC}: differences {why}", uncertainty=SAFETY_UNKNOWN * spread)


def _with_order(order: float, limit: float, error: float, spread: float) -> Estimate:
    """Returns the estimate for a known order; spread: largest difference between runs."""
    if ORDERS[0] <= order <= ORDERS[1]:
        return Estimate(ASYMPTOTIC, order, limit, error, SAFETY * abs(error))
    rate = "slower than first" if order < ORDERS[0] else "faster than second"
    bound = SAFETY * max(abs(error), spread)
    return Estimate(f"not {ASYMPTOTIC}: {rate} order", order, limit, error, bound)


def _fit(h: np.ndarray, phi: np.ndarray, order: float) -> tuple[float, float]:
    """Returns phi_0 and the sum of squared residuals of the fit phi_0 + a h^order."""
    basis = np.column_stack([np.ones_like(h), h**order])
    found, *_ = np.linalg.lstsq(basis, phi, rcond=None)
    return float(found[0]), float(((basis @ found - phi) ** 2).sum())


def _order(h: np.ndarray, phi: np.ndarray) -> float:
    """Returns the order of the best fit: the best of a scan, refined."""
    from scipy.optimize import minimize_scalar  # slow to import, and only used here

    orders = np.linspace(MIN_ORDER, MAX_ORDER, 240)
    k = int(np.argmin([_fit(h, phi, p)[1] for p in orders]))
    ends = orders[max(k - 1, 0)], orders[min(k + 1, len(orders) - 1)]
    options = {"xatol": 1e-9}
    found = minimize_scalar(
        lambda p: _fit(h, phi, p)[1], bounds=ends, method="bounded", options=options
    )
    return float(found.x)


def _mean(values: np.ndarray) -> float:
    """Returns the mean of the finite values, NaN if there are none."""
    return float(np.nanmean(values)) if np.isfinite(values).any() else math.nan


def compare(ledgers: list[dict], probes: list[dict], spacing: float) -> list[Convergence]:
    """Returns the rows from the tables of runs, coarse to fine (see table.read).

    Rows are means over the run of kinetic energy, every probe and the centre of mass, along axes in
    which the centre moves by more than MIN_CENTRE_MOTION times `spacing` [m]; the mechanical energy
    lost; and the root mean square over time of the distance between the centres of mass of
    successive runs.
    """
    paths = [np.column_stack([t[f"centre_{k}_m"] for k in "xyz"]) for t in ledgers]
    moves = np.abs(paths[-1] - paths[-1][0]).max(axis=0) > MIN_CENTRE_MOTION * spacing
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
    distances = [
        float(np.sqrt(((a[:n] - b[:n]) ** 2).sum(axis=1).mean()))
        for a, b in itertools.pairwise(paths)
    ]
    found = _estimate_from_distances(distances)
    rows.append(Convergence("path_to_next_finer", "m", [*distances, math.nan], found))
    return rows


def _row(name: str, unit: str, values: list) -> Convergence:
    values = [float(v) for v in values]
    return Convergence(name, unit, values, estimate(values))


def _lost(ledger: dict) -> float:
    """Returns the mechanical energy lost during the run [J], external work included."""
    energy = energy_less_work(ledger)
    return float(energy[0] - energy[-1])


def _estimate_from_distances(distances: list[float]) -> Estimate:
    """Returns the estimate from positive distances between successive runs: they shrink by
    RATIO^order, and the error of the finest run is the sum of the remaining geometric series."""
    before, last = distances[-2:]
    if last == 0.0:
        return SAME
    if last >= before:
        return _without_order("grow", max(distances))
    order = math.log(before / last) / math.log(RATIO)
    return _with_order(order, math.nan, last / (RATIO**order - 1.0), max(distances))


ESTIMATE_HEADS = ["order", "limit", "error", "uncertainty", "verdict"]


def _cells(row: Convergence, digits: int, unknown: str) -> list[str]:
    e = row.estimate
    numbers = [*row.values, e.order, e.limit, e.error, e.uncertainty]
    shown = (unknown if math.isnan(v) else f"{v:.{digits}g}" for v in numbers)
    return [row.name, row.unit, *shown, e.verdict]


def write(path: Path, rows: list[Convergence], spacings: list[float]) -> None:
    """Writes convergence.csv: a line for the finest spacing [m] of each run, run_1 the coarsest,
    and a line for each figure in its unit."""
    heads = ["quantity", "unit", *(f"run_{k + 1}" for k in range(len(spacings))), *ESTIMATE_HEADS]
    first = ["finest_spacing", "m", *(f"{d:.6g}" for d in spacings), *[""] * len(ESTIMATE_HEADS)]
    cells = [_cells(row, 6, "") for row in rows]
    with replacing(path) as new, open(new, "w", newline="", encoding="utf-8") as file:
        csv.writer(file, lineterminator="\n").writerows([heads, first, *cells])


def text(rows: list[Convergence], spacings: list[float]) -> str:
    """Returns the printed table and its verdict."""
    heads = ["", "", *(f"{1e3 * d:.3g} mm" for d in spacings), *ESTIMATE_HEADS]
    cells = [_cells(row, 4, "-") for row in rows]
    asymptotic = sum(r.estimate.verdict == ASYMPTOTIC for r in rows)
    verdict = f"{asymptotic} of {len(rows)} figures are {ASYMPTOTIC}"
    if asymptotic < len(rows):
        verdict += "; for the others use the uncertainty, or repeat with smaller spacings"
    printed = tabulate(cells, headers=heads, tablefmt="plain", disable_numparse=True)
    return f"{printed}\n{verdict}"


def as_json(rows: list[Convergence]) -> list[dict]:
    """Returns the rows for the summary of the finest run."""
    return [
        {"quantity": row.name, "unit": row.unit, "value": row.values[-1], **vars(row.estimate)}
        for row in rows
    ]
