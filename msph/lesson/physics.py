"""Quantities of physics lessons, measured from the ledger's entries and the poses of bodies."""

import math
from typing import Any

import numpy as np

from msph.fluid.boundary.rigid_bodies import Ball, half_extents, volume
from msph.stage.show import Show

# Time [s] at the end of a run over which forces and jets are averaged.
WINDOW = 0.5
# Points across a body for its submerged share: good to 2 % for level boxes, better for others.
ACROSS = 50
# Time [s] over which amplitudes are means: two periods of the waves of the lessons.
WAVES = 2.0
# Number of periods over which the growth of a swing is a mean: fewer are noisy, and over more
# breaking and friction slow the growth.
GROWING = 3


def _recent(show: Show, name: str, window: float = WINDOW) -> tuple[np.ndarray, np.ndarray]:
    """Returns the times (n,) [s] and values of an attribute of the entries of the last `window`
    [s]."""
    entries = show.ledger.entries
    kept = [e for e in entries if e.time > entries[-1].time - window * (1.0 + 1e-6)]
    return np.array([e.time for e in kept]), np.array([getattr(e, name) for e in kept])


def lift(show: Show) -> float:
    """Returns the mean vertical force [N] of the water on all bodies."""
    time, given = _recent(show, "body_impulse")
    return -float(given[-1, 1] - given[0, 1]) / (time[-1] - time[0]) if len(time) > 1 else math.nan


def jet_speed(show: Show) -> float:
    """Returns the mean speed [m/s] of the water that leaves through outflows."""
    _, mass = _recent(show, "outflow_mass")
    _, momentum = _recent(show, "outflow_momentum")
    left = float(mass[-1] - mass[0])
    return float(np.linalg.norm(momentum[-1] - momentum[0])) / left if left > 0.0 else math.nan


def submerged(show: Show) -> float:
    """Returns the share [%] of the bodies' volume below the level of the water, which follows from
    the volume of the water in a box without other solids."""
    boundary, size = show.simulation.boundary, show.simulation.size
    heights, volumes = [], []
    for k, body in enumerate(boundary.bodies):
        axis = (np.arange(ACROSS) + 0.5) / ACROSS * 2.0 - 1.0
        points = np.stack(np.meshgrid(axis, axis, axis), axis=-1).reshape(-1, 3)
        if isinstance(body, Ball):
            points = points[(points**2).sum(axis=1) < 1.0]
        turned = (points * half_extents(body)) @ boundary.pose(k)[1].T
        heights.append(boundary.centre_at_end(k)[1] + turned[:, 1])
        volumes.append(np.full(len(points), volume(body) / len(points)))
    y, each = np.concatenate(heights), np.concatenate(volumes)
    order = np.argsort(y)
    below = np.cumsum(each[order])
    # At the level Y: area Y = volume of the water + submerged volume.
    filled = size[0] * size[2] * y[order] - below
    under = int(np.searchsorted(filled, show.rest_volume()))
    return 100.0 * float(below[under - 1] if under else 0.0) / float(below[-1])


def _crossings(values: np.ndarray) -> np.ndarray:
    """Returns the fractional indices at which values (n,) rise through zero."""
    before, after = values[:-1], values[1:]
    k = np.flatnonzero((before < 0.0) & (after >= 0.0))
    return k + before[k] / (before[k] - after[k])


def _period(times: np.ndarray, values: np.ndarray) -> float:
    """Returns the mean period [s] of an oscillation about zero, NaN before its second crossing in
    the same direction."""
    crossed = np.interp(_crossings(values), np.arange(len(times)), times)
    return float((crossed[-1] - crossed[0]) / (len(crossed) - 1)) if len(crossed) > 1 else math.nan


def amplitude(times: np.ndarray, values: np.ndarray) -> float:
    """Returns the amplitude of an oscillation over the last WAVES [s], the root of two times its
    standard deviation; NaN for a shorter record."""
    if len(times) < 2 or times[-1] - times[0] < WAVES * (1.0 - 1e-6):
        return math.nan
    return math.sqrt(2.0) * float(values[times > times[-1] - WAVES * (1.0 - 1e-6)].std())


def _since_change(show: Show) -> list[Any]:
    """Returns the entries since gravity changed last."""
    entries = show.ledger.entries
    g = entries[-1].gravity
    first = next((k for k in range(len(entries), 0, -1) if (entries[k - 1].gravity != g).any()), 0)
    return entries[first:]


def sloshing_period(show: Show) -> float:
    """Returns the period [s] at which the water swings along x since gravity changed last."""
    kept = _since_change(show)
    momentum = np.array([e.momentum[0] for e in kept])
    return _period(np.array([e.time for e in kept]), momentum) if len(kept) > 2 else math.nan


def swing_growth(show: Show) -> float:
    """Returns by how much [m] the swing of the centre of mass along x grows in a period, mean of
    the last GROWING periods at this gravity."""
    kept = _since_change(show)
    centre = np.array([e.centre[0] for e in kept])
    # The centre of mass turns where the momentum vanishes.
    turns = _crossings(np.array([e.momentum[0] for e in kept]))[-1 - GROWING :]
    lowest = np.interp(turns, np.arange(len(kept)), centre)
    return float(lowest[0] - lowest[-1]) / GROWING if len(turns) > GROWING else math.nan


def heave_amplitude(show: Show) -> float:
    """Returns the amplitude [m] at which floating bodies rise and fall at this gravity."""
    kept = _since_change(show)
    weight = float(show.simulation.boundary.floating.mass.sum() * np.linalg.norm(kept[-1].gravity))
    heights = np.array([e.floating_potential for e in kept]) / weight
    return amplitude(np.array([e.time for e in kept]), heights)


def heave_period(show: Show) -> float:
    """Returns the period [s] at which floating bodies rise and fall since gravity changed last."""
    kept = _since_change(show)
    momentum = np.array([e.floating_momentum[1] for e in kept])
    return _period(np.array([e.time for e in kept]), momentum) if len(kept) > 2 else math.nan
