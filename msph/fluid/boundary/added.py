"""Bodies and openings added to a running simulation, as rows of numbers in checkpoints."""

import numpy as np

from msph.fluid.boundary.opening import Opening, Valve
from msph.fluid.boundary.rigid_bodies import Ball, Block, Body, centre, half_extents
from msph.parameter import LARGEST

# Lengths of the rows of a body and of an opening.
BODY, OPENING = 8, 20


def body_row(body: Body) -> np.ndarray:
    """Returns the row of a floating block or ball: 1 for a ball, centre and half extents [m] at
    time zero, mass [kg]."""
    assert body.mass is not None
    return np.array(
        [float(isinstance(body, Ball)), *centre(body), *half_extents(body), body.mass], float
    )


def body_of(row: np.ndarray) -> Body:
    """Returns the body of a row, with the default friction. Raises ValueError."""
    row = _checked(row, BODY, "body")
    x, half, mass = row[1:4], row[4:7], float(row[7])
    if not (row[4:] > 0.0).all():
        raise ValueError("an added body has no size and mass")
    if row[0] == 1.0:
        return Ball(x, float(half[0]), mass=mass)
    return Block(x - half, x + half, mass=mass)


def opening_row(opening: Opening) -> np.ndarray:
    """Returns the row of an opening: 1 for an inflow, centre [m], direction, half extents [m], 1
    for a rectangle and its edges, layer, 1 for a valve with its speed [m/s] and end [s]."""
    edges, valve = opening.edges, opening.speed
    assert valve is None or isinstance(valve, Valve)
    return np.array(
        [
            float(opening.enters),
            *opening.centre,
            *opening.direction,
            *opening.half,
            *((0.0,) * 7 if edges is None else (1.0, *edges.ravel())),
            opening.layer,
            *((0.0,) * 3 if valve is None else (1.0, valve.speed, valve.until)),
        ],
        float,
    )


def opening_of(row: np.ndarray, layers: int) -> Opening:
    """Returns the opening of a row in a scene of `layers` layers. Raises ValueError."""
    row = _checked(row, OPENING, "opening")
    if not (row[7:9] > 0.0).all() or not row[4:7].any() or not 0 <= row[16] < layers:
        raise ValueError("an added opening has no size, direction or layer")
    return Opening(
        centre=row[1:4],
        direction=row[4:7],
        half=(float(row[7]), float(row[8])),
        enters=bool(row[0]),
        speed=Valve(float(row[18]), float(row[19])) if row[17] else None,
        edges=row[10:16].reshape(2, 3) if row[9] else None,
        layer=int(row[16]),
    )


def _checked(row: np.ndarray, length: int, what: str) -> np.ndarray:
    """Returns a row in double precision. Raises ValueError."""
    if row.shape != (length,) or row.dtype.kind != "f" or not (np.abs(row) <= LARGEST).all():
        raise ValueError(f"an added {what} is not {length} numbers of -{LARGEST:g} to {LARGEST:g}")
    return row.astype(float)
