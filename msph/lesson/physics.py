"""Quantities of physics lessons, measured from the ledger's entries and the poses of bodies."""

import math
from collections.abc import Callable

import numpy as np

from msph.fluid.boundary.rigid_bodies import Ball, half_extents, volume
from msph.lesson.quantities import quantity
from msph.measure.entry import Entry
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


def _recent(show: Show) -> tuple[Entry, Entry]:
    """Returns the first and the last entry of the last WINDOW [s]."""
    last = show.ledger.entries[-1]
    start = last.time - WINDOW * (1.0 + 1e-6)
    return next(e for e in show.ledger.entries if e.time > start), last


@quantity("N", "vertical force of the water on all bodies, mean of the last 0.5 s")
def lift(show: Show) -> float:
    first, last = _recent(show)
    impulse, time = last.body_impulse - first.body_impulse, last.time - first.time
    return -float(impulse[1]) / time if time > 0.0 else math.nan


@quantity("m/s", "speed of the water in outflows, mean of the last 0.5 s")
def jet_speed(show: Show) -> float:
    """Momentum over mass of the water that has left."""
    first, last = _recent(show)
    momentum = last.outflow_momentum - first.outflow_momentum
    mass = last.outflow_mass - first.outflow_mass
    return float(np.linalg.norm(momentum)) / mass if mass > 0.0 else math.nan


@quantity("%", "share of the bodies' volume below the level of the water", slow=True)
def submerged(show: Show) -> float:
    """The level follows from the volume of the water in a box without other solids."""
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


def _since_change(show: Show, read: Callable[[Entry], float]) -> tuple[np.ndarray, np.ndarray]:
    """Returns the times (n,) [s], and a number that is read from each of the entries, since gravity
    changed last."""
    entries = show.ledger.entries
    g = entries[-1].gravity
    first = next((k for k in range(len(entries), 0, -1) if (entries[k - 1].gravity != g).any()), 0)
    return np.array([e.time for e in entries[first:]]), np.array([read(e) for e in entries[first:]])


@quantity("s", "period of the water's momentum along x at this gravity")
def sloshing_period(show: Show) -> float:
    return _period(*_since_change(show, lambda e: e.momentum[0]))


@quantity(
    "m", "growth per period of the swing of the centre of mass along x, mean of three periods"
)
def swing_growth(show: Show) -> float:
    _, centre = _since_change(show, lambda e: e.centre[0])
    _, momentum = _since_change(show, lambda e: e.momentum[0])
    # The centre of mass turns where the momentum vanishes.
    turns = _crossings(momentum)[-1 - GROWING :]
    lowest = np.interp(turns, np.arange(len(centre)), centre)
    return float(lowest[0] - lowest[-1]) / GROWING if len(turns) > GROWING else math.nan


@quantity("m", "amplitude of the floating bodies' rise and fall, over 2 s")
def heave_amplitude(show: Show) -> float:
    times, potential = _since_change(show, lambda e: e.floating_potential)
    gravity = np.linalg.norm(show.ledger.entries[-1].gravity)
    return amplitude(times, potential / (show.simulation.boundary.floating.mass.sum() * gravity))


@quantity("s", "period of the floating bodies' rise and fall at this gravity")
def heave_period(show: Show) -> float:
    return _period(*_since_change(show, lambda e: e.floating_momentum[1]))
