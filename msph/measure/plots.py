"""Plots of what was measured: ledger.png and probes.png from the tables, by matplotlib."""

from pathlib import Path

import numpy as np

from msph.measure.table import energy_less_work, parts, read
from msph.own_files import replacing

# Inches of a panel, and pixels per inch.
WIDTH, HEIGHT, DPI = 8.0, 2.2, 110

ENERGY, VOLUME = "energy less its start [J]", "surface's volume\nover its start, less 1 [%]"
DENSITY = "density error [-]"
PLOTS = ("ledger.png", "probes.png")
# Panels of ledger.png: what the axis is, and the columns it shows with their labels.
PANELS: tuple[tuple[str, dict[str, str]], ...] = (
    (
        ENERGY,
        {
            "kinetic_J": "kinetic",
            "potential_J": "potential",
            "wall_work_J": "work of walls",
            "user_work_J": "work of the hand",
            "tilt_work_J": "work of tilting",
            "left_J": "energy less work",
        },
    ),
    (
        "centre of mass [m]",
        {"centre_x_m": "x", "centre_y_m": "y", "centre_z_m": "z"},
    ),
    (
        DENSITY,
        {
            "density_error_mean": "mean",
            "density_error_p99": "99th percentile",
            "density_error_max": "largest",
        },
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
# In words on the axes of probes.png.
WORDS = {
    "Pa": "pressure [Pa]",
    "m": "place [m]",
    "m_per_s": "velocity [m/s]",
    "m3_per_s": "flux [m^3/s]",
    "N": "force [N]",
    "N_m": "torque [N m]",
}


def plot(folder: Path, title: str) -> list[Path]:
    """Draws folder/ledger.csv and folder/probes.csv beside them; returns the files."""
    found = [folder / PLOTS[0]]
    _draw(found[0], title, _ledger_panels(read(folder / "ledger.csv")))
    readings = read(folder / "probes.csv")
    if len(readings) > 1:
        found.append(folder / PLOTS[1])
        _draw(found[1], title, _probe_panels(readings))
    return found


# An axis and its curves: times [s] and values by label.
Panel = tuple[str, dict[str, tuple[np.ndarray, np.ndarray]]]


def _ledger_panels(table: dict[str, np.ndarray]) -> list[Panel]:
    """Panels of all columns that hold anything, and of the energy that is not accounted for by
    work: in a method that only dissipates it falls."""
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
                # Works that nobody did are no curves.
                if axis != ENERGY or values.any():
                    curves[label] = table["time_s"][known], values
        if curves:
            panels.append((axis, curves))
    return panels


def _probe_panels(table: dict[str, np.ndarray]) -> list[Panel]:
    """A panel for each unit."""
    panels: dict[str, dict] = {}
    for column in (name for name in table if name != "time_s"):
        name, unit = parts(column)
        curves = panels.setdefault(WORDS[unit], {})
        curves[name] = table["time_s"], table[column]
    return list(panels.items())


def _draw(path: Path, title: str, panels: list[Panel]) -> None:
    # Here, since it takes .3 s to import.
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH, 0.6 + HEIGHT * len(panels)), dpi=DPI, layout="constrained")
    figure.suptitle(title, fontsize=10)
    axes = figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
    for axis, (label, curves) in zip(axes, panels, strict=True):
        for name, (time, values) in curves.items():
            axis.plot(time, values, label=name, lw=1.2, marker="." if len(time) < 40 else "")
        # From what is left of still water to an impact: decades.
        if label == DENSITY:
            axis.set_yscale("log", nonpositive="mask")
        axis.set_ylabel(label, fontsize=8)
        axis.tick_params(labelsize=8)
        axis.grid(alpha=0.3)
        if len(curves) > 1 or label in WORDS.values():
            axis.legend(fontsize=7, loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False)
    axes[-1].set_xlabel("time [s]", fontsize=8)
    with replacing(path) as file:
        figure.savefig(file)
