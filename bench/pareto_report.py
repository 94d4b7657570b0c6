"""Tables of the sweep of speed against error, generated from its results."""

import itertools
import math
from statistics import median

import numpy as np
from scipy.stats import linregress

from bench.cases import CASES
from bench.cases.case import ADAPTIVE, DFSPH, FIXED, UNIFORM, Case
from bench.pareto_figures import LEAST, WITHOUT_RELIEF, drawn, figures, undominated
from bench.pareto_rows import TIME, Pick, Result, disturbed, grouped, place_of
from bench.rows import RESULTS
from bench.tables import markdown

# Error limits for which the fastest run is listed (-).
LIMITS = (0.3, 0.1, 0.03, 0.01, 0.003)
COSTS = {
    TIME: "elapsed s / simulated s",
    "particles": "particles",
    "peak_mib": "peak MiB",
    "solver_residual_mean": "solver residual, mean",
    "solver_residual_max": "largest",
    "kernel_density_error_mean": "kernel density error, mean",
    "kernel_density_error_p99": "99th percentile",
}
# Figures whose range over the starts is not shown.
WITHOUT_RANGE = ("particles", "peak_mib")
WATERS = (UNIFORM, FIXED, ADAPTIVE)


def ours(results: list[Result], water: str) -> list[Result]:
    """Returns the results of the projection method with a kind of water."""
    return [r for r in results if (r.method, r.water) == ("projection", water)]


def words(name: str) -> str:
    """Returns the name of an error in words."""
    return name.replace("_", " ")


def unreached(results: list[Result], case: Case) -> str:
    """Returns a sentence if a run with adaptive layers has a smaller main error than all uniform
    runs, some of which took longer; otherwise ""."""
    uniform = ours(results, UNIFORM)
    longest = max((r.time for r in uniform), default=0.0)
    best = min((r.of(case.main) for r in uniform), default=0.0)
    found = [(r.time, r.of(case.main)) for r in ours(results, ADAPTIVE)]
    nearer = [(time, error) for time, error in found if LEAST < error < best and time < longest]
    if not nearer:
        return ""
    time, error = min(nearer)
    return (
        f"uniform runs of up to {longest:.3g} s per s do not reach the error of adaptive layers in "
        f"{time:.3g}: {words(case.main)} {shown('error', best)}, not {shown('error', error)}"
    )


def ratios(results: list[Result], case: Case) -> list[dict[str, str]]:
    """Returns a row for each run with adaptive layers: how many times faster it is than uniform
    water of the same main error, by medians, and by the ends of the ranges."""
    uniform, found = ours(results, UNIFORM), []
    for result in ours(results, ADAPTIVE):
        speed_up = compare(result, uniform, case.main)
        if speed_up:
            found.append(
                {
                    "resolution": result.resolution,
                    "changes": result.changes,
                    words(case.main): cell(result, case.main),
                    "speed-up of adaptive layers over uniform water": speed_up,
                }
            )
    return found


def compare(result: Result, others: list[Result], error: str) -> str:
    """Returns how many times faster a run is than others of the same error, in words: by medians,
    and from its largest error and time against the others' least to the reverse. Empty if the
    others have no run of this error."""
    middle = _ratio(result, others, error, median, median)
    if not middle:
        return ""
    least, most = (_ratio(result, others, error, *ends) for ends in ((max, min), (min, max)))
    times = f"{'over ' * middle[1]}{digits(middle[0])}"
    ends = [digits(end[0]) if end else "?" for end in (least, most)]
    unlike = least and most and (least[0] > 1.0) == (most[0] > 1.0)
    return f"{times} ({ends[0]} to {ends[1]}){'' if unlike else ', not significant'}"


def digits(value: float) -> str:
    """Returns a number with two significant digits, never with an exponent."""
    return np.format_float_positional(value, precision=2, fractional=False, trim="-")


def _ratio(
    result: Result, others: list[Result], error: str, own: Pick, theirs: Pick
) -> tuple[float, bool] | None:
    """Returns the time of the others at the run's error over the run's time, interpolated in
    logarithms, and whether it is a lower bound, as no other reaches the error; None if the run's
    error exceeds all others or is rounding. own, theirs: which value over the starts to read."""
    known = [r for r in others if math.isfinite(r.time) and math.isfinite(r.of(error))]
    line, wanted = undominated(known, error, theirs), math.log(max(result.of(error, own), LEAST))
    errors = np.log([max(r.of(error, theirs), LEAST) for r in line])
    if not line or not math.log(LEAST) < wanted <= errors.max():
        return None
    time = np.log([r.of(TIME, theirs) for r in line])
    at = math.exp(np.interp(-wanted, -errors, time))
    return at / result.of(TIME, own), bool(wanted < errors.min())


def slope(resolution: list[float], errors: list[float]) -> str:
    """Returns the order of convergence with the spacing, and its standard error."""
    if len(errors) < 3 or not np.isfinite(errors).all():
        return "-"
    fit = linregress(-np.log(resolution), np.log(np.maximum(errors, LEAST)))
    return f"{fit.slope:.1f} +- {fit.stderr:.1f}"


def by_resolution(results: list[Result], water: str, changes: str = "") -> list[Result]:
    """Returns the results of the projection method with a kind of water, coarsest first."""
    own = [r for r in ours(results, water) if r.changes == changes]
    return sorted(own, key=lambda r: float(r.resolution))


def orders(results: list[Result], case: Case) -> list[dict[str, str]]:
    """Returns a row for each kind of water: order of convergence of each error."""
    found = []
    for changes, water in itertools.product(("", WITHOUT_RELIEF), WATERS):
        own = by_resolution(results, water, changes)
        if len(own) > 2:
            resolution = [float(r.resolution) for r in own]
            by = {e: slope(resolution, [r.of(e) for r in own]) for e in case.errors}
            found.append({"water": water, "changes": changes, **by})
    return found


def recommended(results: list[Result]) -> list[dict[str, str]]:
    """Returns a row for each run that is the fastest within an error limit of its case."""
    lines: dict[int, dict[str, str]] = {}
    for case, limit in itertools.product(CASES.values(), LIMITS):
        good = [r for r in drawn(results, case) if r.of(case.main) <= limit]
        if good:
            best = min(good, key=lambda r: r.time)
            # A run that is the fastest for several limits is listed with the smallest.
            lines[id(best)] = {
                "case": case.title,
                "limit": f"{words(case.main)} within {100.0 * limit:g} %",
                "fastest": f"{best.method}, {best.water}",
                "resolution": best.resolution,
                "changes": best.changes,
                "error": shown("error", best.of(case.main)),
                "s per s": shown(TIME, best.time),
            }
    return list(lines.values())


def self_convergence(results: list[Result], case: Case) -> list[dict[str, str]]:
    """Returns the differences of the case's values from the finest uniform run, and their order."""
    own = [r for r in results if all(math.isfinite(r.of(name)) for name in case.values)]
    uniform = by_resolution(own, UNIFORM)
    if len(uniform) < 3 or not case.values:
        return []
    finest, found = uniform[-1], []
    for name in case.values:
        exact = finest.of(name)
        row = {"value": name, "finest": f"{exact:.4g}"}
        for water in WATERS:
            same = [r for r in by_resolution(own, water) if r is not finest]
            apart = [abs(r.of(name) - exact) for r in same]
            for r, difference in zip(same, apart, strict=True):
                row[f"{water} {r.resolution}"] = f"{difference:.2g}"
            row[f"{water}, order"] = slope([float(r.resolution) for r in same], apart)
        found.append(row)
    return found


def table(results: list[Result], case: Case) -> str:
    """Returns the case's results as a Markdown table, fastest first and those without a time last;
    undominated ones are bold."""
    best, lines = undominated(drawn(results, case), case.main), []
    for result in sorted(results, key=lambda r: (math.isnan(r.time), r.time)):
        mark, changes = "**" * (result in best), result.changes
        if disturbed(result.measured, result.of("others")):
            changes += f" ({result.of('others'):.1f} cores busy with other work)"
        if result.failure:
            changes += f" failed: {result.failure}"
        lines.append(
            {
                "method": result.method,
                "water": f"{mark}{result.water}{mark}",
                "resolution": result.resolution,
                "changes": changes,
                "starts": str(result.runs),
                **{head: cell(result, name) for name, head in COSTS.items()},
                **{words(name): cell(result, name) for name in case.errors},
            }
        )
    return markdown(lines)


def cell(result: Result, name: str) -> str:
    """Returns the median of a figure, and its range over the starts."""
    kind = name if name in (TIME, *WITHOUT_RANGE) else "error"
    least, middle, most = (shown(kind, result.of(name, pick)) for pick in (min, median, max))
    if name in WITHOUT_RANGE or least == most:
        return middle
    return f"{middle} ({least} to {most})"


def shown(name: str, value: float) -> str:
    """Formats a figure of a result."""
    if math.isnan(value):
        return "-"
    if name in WITHOUT_RANGE:
        return f"{value:,.0f}"
    if name == TIME:
        return f"{value:.3g}"
    return f"{100.0 * value:.3f} %" if value >= 1e-5 else f"{value:.0e}"


def report(rows: list[dict]) -> str:
    """Writes pareto.md and the figures; returns the text."""
    where = sorted({row["measured"] for row in rows})
    results = grouped(rows)
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
    figures(results, RESULTS)
    text += ["## The fastest run within an error limit\n", f"{markdown(recommended(results))}\n"]
    text += compared_with_peer(results)
    for case in CASES.values():
        own = [r for r in results if r.case == case.name]
        if not own:
            continue
        text += [
            f"## {case.title}\n",
            f"Resolution: {case.across} in finest spacings{'; ' * bool(case.note)}{case.note}. "
            f"Measured {measured(own)}.\n",
        ]
        text += [f"- {words(name)}: {what}" for name, what in case.errors.items()]
        sentence = unreached(drawn(own, case), case)
        text += [f"\n{sentence[0].upper()}{sentence[1:]}."] if sentence else []
        text += ["", table(own, case), ""]
        for title, lines in (
            ("Adaptive layers against uniform water at equal error:", ratios(own, case)),
            ("Order of convergence with the spacing, and its standard error:", orders(own, case)),
            ("Differences from the finest uniform run:", self_convergence(own, case)),
        ):
            if lines:
                text += [title, "", markdown(lines), ""]
        if drawn(own, case):
            text.append(f"![{case.title}](pareto_{case.name}.png)\n")
    found = "\n".join(text)
    (RESULTS / "pareto.md").write_text(found, encoding="utf-8")
    return found


def measured(results: list[Result]) -> str:
    """Returns the dates, numbers of threads and numbers of starts of results, in words."""
    starts = sorted({r.runs for r in results})
    places = [place_of(r.measured) for r in results]
    threads, dates = (sorted(set(each)) for each in zip(*places, strict=True))
    found = [
        f"on {' and '.join(dates)}",
        f"threads: {', '.join(map(str, threads))}",
        f"starts: {' to '.join(str(n) for n in sorted({starts[0], starts[-1]}))}",
    ]
    return "; ".join(found)


def compared_with_peer(results: list[Result]) -> list[str]:
    """Returns the section that compares each run of SPlisHSPlasH with our runs of equal error."""
    lines = []
    for case in CASES.values():
        theirs = [r for r in results if (r.case, r.method) == (case.name, DFSPH)]
        for result, error in itertools.product(theirs, case.peer):
            if math.isfinite(result.of(error)):
                own = [r for r in drawn(results, case, error) if r.method == "projection"]
                lines.append(
                    {
                        "case": case.name,
                        "resolution": result.resolution,
                        "settings": result.changes or "as shipped",
                        "error": f"{words(error)} {cell(result, error)}",
                        "its s per s": cell(result, TIME),
                        "faster at this error": faster(result, own, error),
                    }
                )
    if not lines:
        return []
    compared = [r for r in results if r.case in {line["case"] for line in lines}]
    busy = [
        np.nanmedian([r.of("others") for r in compared if (r.method == DFSPH) == theirs])
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


def faster(result: Result, own: list[Result], error: str) -> str:
    """Returns which program is faster at the error of a run of DFSPH, and by which factor; own: our
    results."""
    if not own:
        return "-"
    worst = max(undominated(own, error), key=lambda r: r.of(error))
    if result.of(error) > worst.of(error):
        factor = result.time / worst.time
        known = f"{cell(worst, error)} in {worst.time:.2g} s per s"
        return (
            f"ours, over {digits(factor)} times: {known}"
            if factor > 1
            else f"unknown; ours: {known}"
        )
    times, found = compare(result, own, error), _ratio(result, own, error, median, median)
    if not found:
        return "-"
    ratio, bound = found
    if bound:
        return "SPlisHSPlasH: no run of ours reaches the error"
    if "not significant" in times:
        return f"not significant: ours takes {times.split(',')[0]} of its time"
    if ratio > 1.0:
        return f"SPlisHSPlasH, {digits(ratio)} times"
    return f"ours, {digits(1.0 / ratio)} times"
