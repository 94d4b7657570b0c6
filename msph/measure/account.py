"""Error table of a run: each error with its limit, and a caution for each error outside it."""

import math
from dataclasses import dataclass

from tabulate import tabulate

from msph.scene.check import MIN_SPACINGS_ACROSS

# Formats of values.
PERCENT, DECIMAL, INTEGER, EXPONENT = "{:+.3f} %", "{:.1f}", "{:.0f}", "{:.1e}"


@dataclass(frozen=True)
class Figure:
    """A row of the table: key in the summary, group, label, limit (in the value's unit), format
    (PERCENT multiplies by 100), and the consequence of a value outside the limit. lower: True for
    a lower limit."""

    key: str
    group: str
    label: str
    limit: float
    form: str
    caution: str
    lower: bool = False

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


# Unless explained, limits are about twice the largest value of the shipped scenes in their first
# 2 s by the projection method (docs/scenes.md).
FIGURES = (
    # Periods of sloshing are 2 % off at 10 spacings, 0.9 % at 12 (bench/results/accuracy.md).
    Figure(
        "spacings_across_depth",
        "resolution",
        "finest spacings across the mean depth",
        10.0,
        DECIMAL,
        "waves are under-resolved: periods are 2 % off at 10 spacings, more at fewer",
        lower=True,
    ),
    Figure(
        "spacings_across_narrowest_gap",
        "resolution",
        "across the narrowest gap",
        float(MIN_SPACINGS_ACROSS),
        DECIMAL,
        "particles pass through the gap one by one or not at all",
        lower=True,
    ),
    # The support of 2.45 spacings less half a spacing between each face and the particles.
    Figure(
        "spacings_across_bodies",
        "resolution",
        "across",
        1.45,
        DECIMAL,
        "water on both sides of the body interacts through it",
        lower=True,
    ),
    # Equal to the limit of the mean bulk density error: both errors shift water levels.
    Figure(
        "mass_laid_error",
        "water",
        "initial mass against the scene's",
        0.005,
        PERCENT,
        "particles are too large for the volumes of water; levels are off by as much",
    ),
    # Rounding of single precision is 1e-7.
    Figure(
        "mass_change",
        "conservation",
        "change of mass",
        1e-6,
        EXPONENT,
        "water was lost or created; please report this as a bug",
    ),
    Figure(
        "outside_most",
        "conservation",
        "most particles outside the box or inside bodies",
        0.0,
        INTEGER,
        "water leaked: a body is too thin or too fast for the particles",
    ),
    # Ten times the largest value: the share of rounding grows as the water moves less.
    Figure(
        "momentum_drift",
        "conservation",
        "momentum created by pair forces",
        1e-4,
        EXPONENT,
        "pair forces are not opposite: the method does not conserve momentum",
    ),
    Figure(
        "angular_momentum_drift",
        "conservation",
        "angular momentum created by pair forces",
        1e-3,
        EXPONENT,
        "pair forces exert a torque: vortices are inaccurate",
    ),
    # Equal to the limit of bench/accuracy.py for still and sloshing water.
    Figure(
        "energy_gain",
        "conservation",
        "energy gain beyond external work",
        0.001,
        PERCENT,
        "the method creates kinetic energy; use smaller particles or time steps",
    ),
    # Large if little water moves: on a lattice, water gains as much while its surface settles.
    Figure(
        "energy_gain_of_motion",
        "conservation",
        "the same over the energy of the motion",
        0.1,
        PERCENT,
        "waves this small are not distinguishable from the settling of the particles",
    ),
    Figure(
        "energy_rise_in_1_s",
        "conservation",
        "energy gain within 1 s without input",
        0.001,
        PERCENT,
        "the method creates kinetic energy while nothing moves the water",
    ),
    Figure(
        "solver_residual_mean",
        "density",
        "solver residual, mean",
        0.002,
        PERCENT,
        "the pressure solve does not reach its own target density",
    ),
    Figure(
        "solver_residual_p99",
        "density",
        "solver residual, 99th percentile",
        0.02,
        PERCENT,
        "one particle in a hundred is compressed: time steps are too long for the impacts",
    ),
    Figure(
        "solver_residual_max",
        "density",
        "solver residual, largest",
        0.5,
        PERCENT,
        "some particles nearly coincide; pressures near them are inaccurate",
    ),
    # Disordered water of the right volume has errors of up to 2 and 6 % (docs/method.md).
    Figure(
        "kernel_density_error_mean",
        "density",
        "kernel density error, mean",
        0.03,
        PERCENT,
        "particles are very unevenly arranged or compressed",
    ),
    Figure(
        "kernel_density_error_p99",
        "density",
        "kernel density error, 99th percentile",
        0.1,
        PERCENT,
        "one particle in a hundred nearly coincides with another",
    ),
    Figure(
        "bulk_density_error_mean",
        "density",
        "bulk density error, mean",
        0.005,
        PERCENT,
        "the water occupies less or more than its volume",
    ),
    Figure(
        "bulk_density_error_worst",
        "density",
        "bulk density error, worst",
        0.02,
        PERCENT,
        "at some time the water occupies less or more than its volume",
    ),
    Figure(
        "volume_error_mean",
        "volume",
        "volume within the surface mesh, mean",
        0.002,
        PERCENT,
        "the image shows less or more water than there is",
    ),
    Figure(
        "volume_error_worst",
        "volume",
        "volume within the surface mesh, worst",
        0.02,
        PERCENT,
        "in some images water is missing or added",
    ),
)


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
        found.append(f"{line.label}: {value} (limit {limit}): {figure.caution}{why}")
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
