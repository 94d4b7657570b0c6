"""Plots of a run's tables: ledger.png and probes.png."""

from pathlib import Path

import numpy as np

from msph.measure.entry import energy_less_work
from msph.measure.table import parts, read
from msph.own_files import replacing

# Size of a panel [inches], and pixels per inch.
WIDTH, HEIGHT, DPI = 8.0, 2.2, 110

ENERGY, VOLUME = "change of energy [J]", "change of the\nsurface's volume [%]"
RESIDUAL = "solver residual [-]"
PLOTS = ("ledger.png", "probes.png")
# Panels of ledger.png: axis label, and columns with their labels.
PANELS: tuple[tuple[str, dict[str, str]], ...] = (
    (
        ENERGY,
        {
            "kinetic_J": "kinetic",
            "potential_J": "potential",
            "wall_work_J": "work of walls",
            "user_work_J": "work of the user",
            "inertia_work_J": "work of inertial forces",
            "tilt_work_J": "work of turning gravity",
            "left_J": "energy less work",
        },
    ),
    (
        "centre of mass [m]",
        {"centre_x_m": "x", "centre_y_m": "y", "centre_z_m": "z"},
    ),
    (
        RESIDUAL,
        {
            "solver_residual_mean": "mean",
            "solver_residual_p99": "99th percentile",
            "solver_residual_max": "largest",
        },
    ),
    (
        "kernel density error [-]",
        {"kernel_density_error_mean": "mean", "kernel_density_error_p99": "99th percentile"},
    ),
    (
        "bulk density over rest [-]",
        {
            "bulk_density_least": "least",
            "bulk_density_mean": "mean",
            "bulk_density_most": "most",
        },
    ),
    (VOLUME, {"volume_m3": "volume"}),
    ("top speed [m/s]", {"top_speed_m_per_s": "fastest particle"}),
)
# Time [s] in which water that starts on a lattice comes to rest (docs/method.md).
SETTLING = 0.5
# Axis labels of probes.png by unit.
AXIS_LABELS = {
    "Pa": "pressure [Pa]",
    "m": "position [m]",
    "m_per_s": "velocity [m/s]",
    "m3_per_s": "flux [m^3/s]",
    "N": "force [N]",
    "N_m": "torque [N m]",
}


def plot(folder: Path, title: str) -> list[Path]:
    """Plots folder/ledger.csv and folder/probes.csv; returns the image files."""
    found = [folder / PLOTS[0]]
    _draw(found[0], title, _ledger_panels(read(folder / "ledger.csv")))
    readings = read(folder / "probes.csv")
    if len(readings) > 1:
        found.append(folder / PLOTS[1])
        _draw(found[1], title, _probe_panels(readings))
    return found


# Axis label and curves: times [s] and values by label.
Panel = tuple[str, dict[str, tuple[np.ndarray, np.ndarray]]]


def _ledger_panels(table: dict[str, np.ndarray]) -> list[Panel]:
    """Returns the panels of all columns with values, and of the energy less external work, which
    falls for a dissipative method."""
    table = {**table, "left_J": energy_less_work(table)}
    panels: list[Panel] = []
    for axis, columns in PANELS:
        curves = {}
        for name, label in columns.items():
            if name in table and np.isfinite(table[name]).any():
                known = np.isfinite(table[name])
                values = table[name][known]
                if axis == ENERGY:
                    values = values - values[0]
                if axis == VOLUME:
                    values = 100.0 * (values / values[0] - 1.0)
                # Energies that stay zero get no curve.
                if axis != ENERGY or values.any():
                    curves[label] = table["time_s"][known], values
        if curves:
            panels.append((axis, curves))
    return panels


def _probe_panels(table: dict[str, np.ndarray]) -> list[Panel]:
    """Returns a panel for each unit."""
    panels: dict[str, dict] = {}
    for column in (name for name in table if name != "time_s"):
        name, unit = parts(column)
        panels.setdefault(AXIS_LABELS[unit], {})[name] = table["time_s"], table[column]
    return list(panels.items())


def notes(label: str, curves: dict[str, tuple[np.ndarray, np.ndarray]]) -> list[str]:
    """Returns a line that explains gaps and early negative pressures of probes, if any."""
    if label not in AXIS_LABELS.values():
        return []
    found = []
    if any(np.isnan(values).any() for _, values in curves.values()):
        found.append("gap: no water at the probe")
    early = (values[time <= time[0] + SETTLING] for time, values in curves.values())
    if label == AXIS_LABELS["Pa"] and any((values < 0.0).any() for values in early):
        found.append("negative at first: particles still leave their initial lattice")
    return ["; ".join(found)] if found else []


def _draw(path: Path, title: str, panels: list[Panel]) -> None:
    from matplotlib.figure import Figure  # 0.3 s to import

    figure = Figure(figsize=(WIDTH, 0.6 + HEIGHT * len(panels)), dpi=DPI, layout="constrained")
    figure.suptitle(title, fontsize=10)
    axes = figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
    for axis, (label, curves) in zip(axes, panels, strict=True):
        for name, (time, values) in curves.items():
            axis.plot(time, values, label=name, lw=1.2, marker="." if len(time) < 40 else "")
        # From still water to an impact, errors span decades.
        if label == RESIDUAL and any((values > 0.0).any() for _, values in curves.values()):
            axis.set_yscale("log", nonpositive="mask")
        axis.set_ylabel(label, fontsize=8)
        for note in notes(label, curves):
            axis.set_title(note, fontsize=7, loc="left", color="0.3")
        axis.tick_params(labelsize=8)
        axis.grid(alpha=0.3)
        if len(curves) > 1 or label in AXIS_LABELS.values():
            axis.legend(fontsize=7, loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False)
    axes[-1].set_xlabel("time [s]", fontsize=8)
    with replacing(path) as file:
        figure.savefig(file)
