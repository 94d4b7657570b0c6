"""Error table of a run: each error with its limit, and a caution for each error outside it."""

import math
from dataclasses import dataclass

from tabulate import tabulate

from msph.scene.check import MIN_SPACINGS_ACROSS

# Formats of values.
PERCENT, DECIMAL, INTEGER, EXPONENT = "{:+.3f} %", "{:.1f}", "{:.0f}", "{:.1e}"


# A row of a group: key in the summary, limit (in the value's unit; of the resolution a lower
# limit), format (PERCENT multiplies by 100), label. Unless explained, limits are about twice the
# largest value of the shipped scenes in their first 2 s by the projection method (docs/scenes.md).
GROUPS = {
    "resolution": (
        # Periods of sloshing are 0.1 % off at 10 to 25 spacings (bench/results/accuracy.md).
        ("spacings_across_depth", 10.0, DECIMAL, "finest spacings across the mean depth"),
        (
            "spacings_across_narrowest_gap",
            float(MIN_SPACINGS_ACROSS),
            DECIMAL,
            "across the narrowest gap",
        ),
        # The support of 2.45 spacings less half a spacing between each face and the particles.
        ("spacings_across_bodies", 1.45, DECIMAL, "across"),
    ),
    "water": (
        # Equal to the limit of the mean bulk density error: both errors shift water levels.
        ("mass_laid_error", 0.005, PERCENT, "initial mass against the scene's"),
    ),
    "conservation": (
        # Rounding of single precision is 1e-7.
        ("mass_change", 1e-6, EXPONENT, "change of mass"),
        ("outside_most", 0.0, INTEGER, "most particles outside the box or inside bodies"),
        # Ten times the largest value: the share of rounding grows as the water moves less.
        ("momentum_drift", 1e-4, EXPONENT, "momentum created by pair forces"),
        ("angular_momentum_drift", 1e-3, EXPONENT, "angular momentum created by pair forces"),
        # Equal to the limit of bench/accuracy.py for still and sloshing water.
        ("energy_gain", 0.001, PERCENT, "energy gain beyond external work"),
        # Large if little water moves: on a lattice, water gains as much while its surface settles.
        ("energy_gain_of_motion", 0.1, PERCENT, "the same over the energy of the motion"),
        ("energy_rise_in_1_s", 0.001, PERCENT, "energy gain within 1 s without input"),
    ),
    "density": (
        ("solver_residual_mean", 0.002, PERCENT, "solver residual, mean"),
        ("solver_residual_p99", 0.02, PERCENT, "solver residual, 99th percentile"),
        ("solver_residual_max", 0.5, PERCENT, "solver residual, largest"),
        # Disordered water of the right volume has errors of up to 2 and 6 % (docs/method.md).
        ("kernel_density_error_mean", 0.03, PERCENT, "kernel density error, mean"),
        ("kernel_density_error_p99", 0.1, PERCENT, "kernel density error, 99th percentile"),
        ("bulk_density_error_mean", 0.005, PERCENT, "bulk density error, mean"),
        ("bulk_density_error_worst", 0.02, PERCENT, "bulk density error, worst"),
    ),
    "volume": (
        ("volume_error_mean", 0.002, PERCENT, "volume within the surface mesh, mean"),
        ("volume_error_worst", 0.02, PERCENT, "volume within the surface mesh, worst"),
    ),
}
# Consequence of a value outside its limit.
CAUTIONS = {
    "spacings_across_depth": "waves are under-resolved: their periods were measured at 10 spacings "
    "and more only (0.1 % off)",
    "spacings_across_narrowest_gap": "particles pass through the gap one by one or not at all",
    "spacings_across_bodies": "water on both sides of the body interacts through it",
    "mass_laid_error": "particles are too large for the volumes of water; levels are off by as "
    "much",
    "mass_change": "water was lost or created; please report this as a bug",
    "outside_most": "water leaked: a body is too thin or too fast for the particles",
    "momentum_drift": "pair forces are not opposite: the method does not conserve momentum",
    "angular_momentum_drift": "pair forces exert a torque: vortices are inaccurate",
    "energy_gain": "the method creates kinetic energy; use smaller particles or time steps",
    "energy_gain_of_motion": "waves this small are not distinguishable from the settling of the "
    "particles",
    "energy_rise_in_1_s": "the method creates kinetic energy while nothing moves the water",
    "solver_residual_mean": "the pressure solve does not reach its own target density",
    "solver_residual_p99": "one particle in a hundred is compressed: time steps are too long for "
    "the impacts",
    "solver_residual_max": "some particles nearly coincide; pressures near them are inaccurate",
    "kernel_density_error_mean": "particles are very unevenly arranged or compressed",
    "kernel_density_error_p99": "one particle in a hundred nearly coincides with another",
    "bulk_density_error_mean": "the water occupies less or more than its volume",
    "bulk_density_error_worst": "at some time the water occupies less or more than its volume",
    "volume_error_mean": "the image shows less or more water than there is",
    "volume_error_worst": "in some images water is missing or added",
}


@dataclass(frozen=True)
class Figure:
    """A row of the table, with its group."""

    key: str
    limit: float
    form: str
    label: str
    group: str

    @property
    def lower(self) -> bool:
        """True for a lower limit."""
        return self.group == "resolution"

    def accepts(self, value: float) -> bool:
        """Returns True if a finite value is within the limit."""
        return value >= self.limit if self.lower else abs(value) <= self.limit

    def formatted(self, value: float) -> str:
        """Returns the printed value."""
        return self.form.format(100.0 * value if self.form == PERCENT else value)

    def formatted_limit(self) -> str:
        """Returns the printed limit."""
        sign = ">=" if self.lower else "<=" if self.limit else "="
        percent = self.form == PERCENT
        return f"{sign} {100.0 * self.limit:g} %" if percent else f"{sign} {self.limit:g}"


FIGURES = [Figure(*row, group) for group, rows in GROUPS.items() for row in rows]


@dataclass(frozen=True)
class Line:
    """A figure of one run: its key in the summary, label and value (NaN if unknown)."""

    figure: Figure
    key: str
    label: str
    value: float

    @property
    def known(self) -> bool:
        return math.isfinite(self.value)

    @property
    def good(self) -> bool:
        return not self.known or self.figure.accepts(self.value)


def account(found: dict[str, float]) -> list[Line]:
    """Returns a line for each figure of `found`, by key; figures of bodies: a line per body."""
    lines = []
    for figure in FIGURES:
        for key, value in found.items():
            part = key.removeprefix(figure.key)
            if key.startswith(figure.key) and (not part or part.startswith(".")):
                label = f"{figure.label} bodies{part}" if part else figure.label
                lines.append(Line(figure, key, label, float(value)))
    return lines


def cautions(lines: list[Line], volume_reason: str | None = None) -> list[str]:
    """Returns a caution for each line outside its limit. volume_reason: cause of missing volume."""
    found = []
    for line in (line for line in lines if not line.good):
        figure = line.figure
        why = f"; {volume_reason}" if volume_reason and figure.group == "volume" else ""
        value, limit = figure.formatted(line.value), figure.formatted_limit()
        found.append(f"{line.label}: {value} (limit {limit}): {CAUTIONS[figure.key]}{why}")
    return found


def text(lines: list[Line], notes: list[str], mass: dict[str, float]) -> str:
    """Returns the printed table followed by the cautions `notes`."""
    rows, group = [], ""
    for line in lines:
        figure = line.figure
        value = figure.formatted(line.value) if line.known else "unknown"
        if figure.key == "mass_laid_error":
            value += f" ({mass['mass_laid_kg']:.4g} of {mass['mass_asked_kg']:.4g} kg)"
        mark = "" if line.good else "outside"
        new = figure.group if figure.group != group else ""
        rows.append([new, line.label, value, figure.formatted_limit(), mark])
        group = figure.group
    heads = ["Errors of this run", "", "", "limit", ""]
    table = tabulate(rows, headers=heads, tablefmt="plain", disable_numparse=True)
    verdict = [f"caution: {note}" for note in notes] or ["all within their limits"]
    return "\n".join([table, *verdict])
