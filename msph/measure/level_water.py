"""Potential energy of level water, to which all water in a box or container comes to rest."""

import numpy as np

from msph.fluid.simulation import Simulation

# Number of voxels of the room of the water. Boxes without bodies are exact with any number.
VOXELS = 200_000


def level_potential(simulation: Simulation, gravity: np.ndarray, mass: float) -> float:
    """Returns the least potential energy [J] of `mass` [kg] of water at rest density under gravity
    (3,) [m/s^2], zero at the origin: level water that fills the room outside bodies from its lowest
    place, all parts of which count as connected. NaN if the room is too small."""
    size = np.array(simulation.region)
    edge = (size.prod() / VOXELS) ** (1.0 / 3.0)
    shape = np.maximum(np.round(size / edge), 1).astype(int)
    cell = size / shape
    centres = (np.indices(shape).reshape(3, -1).T + 0.5) * cell
    centres = centres[simulation.boundary.free(centres, 0.0)]
    # Potential energy per mass [J/kg] of the water's level, over the volume below it.
    levels, counts = np.unique((-centres @ gravity).round(9), return_counts=True)
    below = (np.cumsum(counts) - 0.5 * counts) * cell.prod()
    density = simulation.layers.finest.density
    volume = mass / density
    if len(levels) < 2 or volume > counts.sum() * cell.prod():
        return float("nan")
    slope = (levels[1] - levels[0]) / (below[1] - below[0])
    below, levels = np.append(0.0, below), np.append(levels[0] - slope * below[0], levels)
    inside = below < volume
    x = np.append(below[inside], volume)
    return float(
        density * np.trapezoid(np.append(levels[inside], np.interp(volume, below, levels)), x)
    )
