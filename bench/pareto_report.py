"""Tables of the sweep of speed against error, generated from its rows."""

import itertools
import math

import numpy as np
from scipy.stats import linregress

from bench.cases import CASES
from bench.cases.case import ADAPTIVE, DFSPH, FIXED, UNIFORM, Case
from bench.pareto_figures import LEAST, WITHOUT_RELIEF, drawn, figures, undominated
from bench.pareto_rows import disturbed, grouped, high, low, number, place_of
from bench.rows import RESULTS
from bench.tables import markdown

# Error limits for which the fastest run is listed (-).
LIMITS = (0.3, 0.1, 0.03, 0.01, 0.003)
COSTS = {
    "wall_per_simulated": "elapsed s / simulated s",
    "particles": "particles",
    "peak_mib": "peak MiB",
    "solver_residual_mean": "solver residual, mean",
    "solver_residual_max": "largest",
    "kernel_density_error_mean": "kernel density error, mean",
    "kernel_density_error_p99": "99th percentile",
}
# Figures whose range over the starts is not shown.
WITHOUT_RANGE = ("particles", "peak_mib")


def by_water(rows: list[dict]) -> dict[str, list[dict]]:
    """Returns the rows of the projection method by kind of water."""
    return {
        w: [r for r in rows if (r["method"], r["water"]) == ("projection", w)] for w in STYLES_OF
    }


def unreached(rows: list[dict], case: Case) -> str:
    """Returns a sentence if a run with adaptive layers has a smaller main error than all uniform
    runs, some of which took longer; otherwise ""."""
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


def ratios(rows: list[dict], case: Case) -> list[dict[str, str]]:
    """Returns a row for each run with adaptive layers: how many times faster it is than uniform
    water of the same main error, by medians, and by the ends of the ranges."""
    uniform, found = by_water(rows)[UNIFORM], []
    for row in by_water(rows)[ADAPTIVE]:
        speed_up = compare(row, uniform, case.main)
        if speed_up:
            found.append(
                {
                    "resolution": row["resolution"],
                    "changes": row["changes"],
                    case.main.replace("_", " "): cell(row, case.main),
                    "speed-up of adaptive layers over uniform water": speed_up,
                }
            )
    return found


def compare(row: dict, others: list[dict], error: str) -> str:
    """Returns how many times faster a run is than others of the same error, in words: by medians,
    and from the row's largest error and time against the others' least to the reverse. Empty if the
    others have no run of this error."""
    middle = _ratio(row, others, error, number, number)
    if not middle:
        return ""
    least, most = (_ratio(row, others, error, *ends) for ends in ((high, low), (low, high)))
    words = f"{'over ' * middle[1]}{digits(middle[0])}"
    ends = [digits(end[0]) if end else "?" for end in (least, most)]
    unlike = least and most and (least[0] > 1.0) == (most[0] > 1.0)
    return f"{words} ({ends[0]} to {ends[1]}){'' if unlike else ', not significant'}"


def digits(value: float) -> str:
    """Returns a number with two significant digits, never with an exponent."""
    return np.format_float_positional(value, precision=2, fractional=False, trim="-")


def _ratio(row: dict, others: list[dict], error: str, own, theirs) -> tuple[float, bool] | None:
    """Returns the time of the others at the row's error over the row's time, interpolated in
    logarithms, and whether it is a lower bound, as no other reaches the error; None if the row's
    error exceeds all others or is rounding. own, theirs: which value over the starts to read."""
    names = (error, "wall_per_simulated")
    known = [r for r in others if all(np.isfinite(number(r, name)) for name in names)]
    read = [{**r, **{name: theirs(r, name) for name in names}} for r in known]
    line, wanted = undominated(read, error), math.log(max(own(row, error), LEAST))
    errors = np.log([max(r[error], LEAST) for r in line])
    if not line or not math.log(LEAST) < wanted <= errors.max():
        return None
    time = np.log([number(r, "wall_per_simulated") for r in line])
    at = math.exp(np.interp(-wanted, -errors, time))
    return at / own(row, "wall_per_simulated"), bool(wanted < errors.min())


STYLES_OF = (UNIFORM, FIXED, ADAPTIVE)


def slope(resolution: list[float], errors: list[float]) -> str:
    """Returns the order of convergence with the spacing, and its standard error."""
    if len(errors) < 3 or not np.isfinite(errors).all():
        return "-"
    fit = linregress(-np.log(resolution), np.log(np.maximum(errors, LEAST)))
    return f"{fit.slope:.1f} +- {fit.stderr:.1f}"


def orders(rows: list[dict], case: Case) -> list[dict[str, str]]:
    """Returns a row for each kind of water: order of convergence of each error."""
    found = []
    for change, water in itertools.product(("", WITHOUT_RELIEF), STYLES_OF):
        own = [
            r
            for r in rows
            if (r["method"], r["water"], r["changes"]) == ("projection", water, change)
        ]
        own.sort(key=lambda r: float(r["resolution"]))
        if len(own) > 2:
            resolution = [float(r["resolution"]) for r in own]
            by = {e: slope(resolution, [number(r, e) for r in own]) for e in case.errors}
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
                    "resolution": best["resolution"],
                    "changes": best["changes"],
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
        and not r["changes"]
        and np.isfinite(number(r, (case.values or ("",))[0]))
    ]
    uniform = sorted(
        (r for r in own if r["water"] == UNIFORM), key=lambda r: float(r["resolution"])
    )
    if len(uniform) < 3:
        return []
    finest, found = uniform[-1], []
    for name in case.values:
        exact, row = number(finest, name), {"value": name, "finest": f"{number(finest, name):.4g}"}
        for water in STYLES_OF:
            same = [r for r in own if r["water"] == water and r is not finest]
            same.sort(key=lambda r: float(r["resolution"]))
            apart = [abs(number(r, name) - exact) for r in same]
            for r, difference in zip(same, apart, strict=True):
                row[f"{water} {r['resolution']}"] = f"{difference:.2g}"
            row[f"{water}, order"] = slope([float(r["resolution"]) for r in same], apart)
        found.append(row)
    return found


def table(rows: list[dict], case: Case) -> str:
    """Returns the case's rows as a Markdown table, fastest first, undominated ones in bold."""
    best = [id(row) for row in undominated(drawn(rows, case), case.main)]
    lines = []
    for row in sorted((r for r in rows if r["case"] == case.name), key=order):
        mark = "**" if id(row) in best else ""
        cells = {"method": row["method"], "water": f"{mark}{row['water']}{mark}"}
        cells |= {"resolution": row["resolution"], "changes": row["changes"]}
        cells["starts"] = str(row["starts"])
        for name, head in COSTS.items():
            cells[head] = cell(row, name)
        for name in case.errors:
            cells[name.replace("_", " ")] = cell(row, name)
        if disturbed(row):
            cells["changes"] += f" ({number(row, 'others'):.1f} cores busy with other work)"
        if row.get("failure"):
            cells["changes"] += f" failed: {row['failure']}"
        lines.append(cells)
    return markdown(lines)


def cell(row: dict, name: str) -> str:
    """Returns the median of a figure, and its range over the starts."""
    kind = name if name in ("wall_per_simulated", *WITHOUT_RANGE) else "error"
    middle = shown(kind, number(row, name))
    ends = [shown(kind, end(row, name)) for end in (low, high)]
    if name in WITHOUT_RANGE or ends[0] == ends[1]:
        return middle
    return f"{middle} ({' to '.join(ends)})"


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


def report(rows: list[dict]) -> str:
    """Writes pareto.md and the figures; returns the text."""
    where = sorted({row["measured"] for row in rows})
    rows = grouped(rows)
    text = [
        "# Speed against error\n",
        "`python bench/run.py pareto`\n",
        *(f"- {place}" for place in where),
        "",
        "Elapsed seconds per simulated second, in frames of 1/60 s; peak memory of the process, "
        "150 MiB of which is Python and\nTaichi. Every row is the median of its starts, which "
        "differ in the initial displacements, with the range in brackets.\n*Solver residual*: "
        "max(rho/rho0 - 1, 0) with the solver's own density; *kernel density error*: the same by a "
        "plain sum of the\nM5 kernel over the positions. Bold: no other row is faster and has a "
        "smaller main error, the first of the case's list.\nRows with and without shear relief met "
        "different loads; [friction](friction.md) compares them in turn.\n",
    ]
    figures(rows, RESULTS)
    text += ["## The fastest run within an error limit\n", f"{markdown(recommended(rows))}\n"]
    text += compared_with_peer(rows)
    for case in CASES.values():
        own = [row for row in rows if row["case"] == case.name]
        if not own:
            continue
        text += [
            f"## {case.title}\n",
            f"Resolution: {case.across} in finest spacings{'; ' * bool(case.note)}{case.note}. "
            f"Measured {measured(own)}.\n",
        ]
        text += [f"- {name.replace('_', ' ')}: {what}" for name, what in case.errors.items()]
        words = unreached(drawn(rows, case), case)
        text += [f"\n{words[0].upper()}{words[1:]}."] if words else []
        text += ["", table(rows, case), ""]
        for title, lines in (
            ("Adaptive layers against uniform water at equal error:", ratios(own, case)),
            ("Order of convergence with the spacing, and its standard error:", orders(own, case)),
            ("Differences from the finest uniform run:", self_convergence(rows, case)),
        ):
            if lines:
                text += [title, "", markdown(lines), ""]
        if drawn(rows, case):
            text.append(f"![{case.title}](pareto_{case.name}.png)\n")
    found = "\n".join(text)
    (RESULTS / "pareto.md").write_text(found, encoding="utf-8")
    return found


def measured(rows: list[dict]) -> str:
    """Returns the dates, numbers of threads and numbers of starts of the rows, in words."""
    starts = sorted({row["starts"] for row in rows})
    threads, dates = (sorted(set(each)) for each in zip(*map(place_of, rows), strict=True))
    found = [
        f"on {' and '.join(dates)}",
        f"threads: {', '.join(map(str, threads))}",
        f"starts: {' to '.join(str(n) for n in sorted({starts[0], starts[-1]}))}",
    ]
    return "; ".join(found)


def compared_with_peer(rows: list[dict]) -> list[str]:
    """Returns the section that compares each run of SPlisHSPlasH with our runs of equal error."""
    lines = []
    for case in CASES.values():
        own = [r for r in rows if r["case"] == case.name]
        theirs = [r for r in own if r["method"] == DFSPH]
        for row, error in itertools.product(theirs, case.peer):
            if np.isfinite(number(row, error)):
                ours = [r for r in drawn(own, case, error) if r["method"] == "projection"]
                lines.append(
                    {
                        "case": case.name,
                        "resolution": row["resolution"],
                        "settings": row["changes"] or "as shipped",
                        "error": f"{error.replace('_', ' ')} {cell(row, error)}",
                        "its s per s": cell(row, "wall_per_simulated"),
                        "faster at this error": faster(row, ours, error),
                    }
                )
    if not lines:
        return []
    compared = [r for r in rows if r["case"] in {line["case"] for line in lines}]
    busy = [
        np.nanmedian([number(r, "others") for r in compared if (r["method"] == DFSPH) == theirs])
        for theirs in (False, True)
    ]
    return [
        "## SPlisHSPlasH\n",
        "DFSPH (Bender and Koschier 2015) of pySPlisHSPlasH, as shipped and with other settings "
        "(viscosity [m^2/s], cfl: factor of\nthe Courant number, tolerance: mean density error in "
        "%, dt: longest step [s]), from the same initial particles. Its walls act\nat a distance "
        "and are therefore outside the tank, as far as still water then has its level. All errors "
        "are computed from\npositions and velocities by the code that measures ours. Ours: "
        "the fastest run, uniform or layered, with at most the same\nerror, interpolated. "
        f"Other work kept {busy[0]:.1f} cores busy during our runs and {busy[1]:.1f} during its "
        "runs (medians).\n",
        markdown(lines),
        "",
    ]


def faster(row: dict, ours: list[dict], error: str) -> str:
    """Returns which program is faster at the error of a run of DFSPH, and by which factor."""
    if not ours:
        return "-"
    worst = max(undominated(ours, error), key=lambda r: number(r, error))
    if number(row, error) > number(worst, error):
        factor = number(row, "wall_per_simulated") / number(worst, "wall_per_simulated")
        own = f"{cell(worst, error)} in {worst['wall_per_simulated']:.2g} s per s"
        return (
            f"ours, over {digits(factor)} times: {own}" if factor > 1 else f"unknown; ours: {own}"
        )
    words = compare(row, ours, error)
    if not words:
        return "-"
    ratio, bound = _ratio(row, ours, error, number, number) or (1.0, False)
    if bound:
        return "SPlisHSPlasH: no run of ours reaches the error"
    if "not significant" in words:
        return f"not significant: ours takes {words.split(',')[0]} of its time"
    if ratio > 1.0:
        return f"SPlisHSPlasH, {digits(ratio)} times"
    return f"ours, {digits(1.0 / ratio)} times"
