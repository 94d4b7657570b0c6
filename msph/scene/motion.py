"""Motion of the tank: expressions, tables and the sway as one path over time."""

import csv
import functools
import math
from collections.abc import Callable

import numpy as np

from msph.errors import BadInputError, did_you_mean
from msph.expressions import OverTime
from msph.fluid.boundary.rigid_bodies import rotations
from msph.fluid.moving_box import INTERVAL, Path, at_rest
from msph.parameter import LARGEST, MAX_SPEED
from msph.scene.errors import explaining, require
from msph.scene.schema import BodyEntry, Scene, Sway, TankMotion

# Columns of a motion table: the time, and the displacement and angle.
TIME, COLUMNS = "time_s", ("x_m", "y_m", "z_m", "angle_deg")
# Number of times over the duration at which expressions are checked.
TRIALS = 500
# Least time between two rows of a table [s].
LEAST_GAP = 1e-6
# Displacement [m] and angle [deg] of a motion at a time [s], (4,).
Numbers = Callable[[float], np.ndarray]

# Limit of a speed, in messages.
TOO_FAST = f"at most {MAX_SPEED:g} m/s is allowed"

# Number of poses that a path caches, since consecutive steps need poses at the same times.
PLACES = 16


class TableError(BadInputError):
    """A table of a motion that cannot be used; str() is one line."""


def box_path(scene: Scene) -> Path:
    """Returns the path of the box of a checked scene."""
    home = 0.5 * np.array(scene.box.size)
    parts = []
    if scene.sway.angle:
        height = home[1] if scene.sway.height is None else scene.sway.height
        parts.append((sway_numbers(scene.sway), TankMotion(centre=(home[0], height, home[2]))))
    parts += [
        (numbers(motion, scene.duration, f"motion.{k}"), motion)
        for k, motion in enumerate(scene.motion)
    ]
    if not parts:
        return at_rest
    turns = []
    for own, motion in parts:
        axis = np.array(motion.axis) / np.linalg.norm(motion.axis)
        turns.append((own, axis, home if motion.centre is None else np.array(motion.centre)))

    @functools.lru_cache(PLACES)
    def path(time: float) -> tuple[np.ndarray, np.ndarray]:
        place, turned = home, np.eye(3)
        for own, axis, centre in turns:
            *shift, angle = own(time)
            turn = rotations(math.radians(angle) * axis[None])[0]
            place, turned = centre + turn @ (place - centre) + shift, turn @ turned
        return place - home, turned

    return path


def numbers(motion: TankMotion, duration: float, key: str) -> Numbers:
    """Returns the displacement and angle of a motion. Raises ExpressionError, TableError."""
    if motion.table is not None:
        return table_numbers(motion.table)
    return formula_numbers(motion, duration, key)


def formula_numbers(given: TankMotion | BodyEntry, duration: float, key: str) -> Numbers:
    """Returns the displacement and angle by the expressions of a motion or body, the table `key` of
    a scene of `duration` [s]. Raises ExpressionError."""
    keys = [f"{key}.displacement.{i}" for i in range(3)] + [f"{key}.angle"]
    formulas = (*given.displacement, given.angle)
    parts = [OverTime(f, duration, k) for f, k in zip(formulas, keys, strict=True)]
    return lambda time: np.array([part(time) for part in parts])


def sway_numbers(sway: Sway) -> Numbers:
    """Returns the angle of the sway: a sine that begins and ends gently."""
    fade = 0.25 * min(sway.period, sway.seconds)

    def at(time: float) -> np.ndarray:
        inside = min(max(time, 0.0), max(sway.seconds - time, 0.0))
        part = ramp(inside / fade) if fade else 0.0
        angle = sway.angle * part * math.sin(2.0 * math.pi * time / sway.period)
        return np.array([0.0, 0.0, 0.0, angle])

    return at


def ramp(share: float) -> float:
    """Returns a smooth transition from 0 at a share of 0 to 1 at a share of 1, without a jump of
    the acceleration (-)."""
    s = min(max(share, 0.0), 1.0)
    return s * s * s * (10.0 - 15.0 * s + 6.0 * s * s)


def table_numbers(name: str) -> Numbers:
    """Returns the motion of a table: cubic splines at rest at both ends. Raises TableError."""
    from scipy.interpolate import CubicSpline  # 0.3 s to import, and only tables need it

    columns = _read(name)
    times = columns.pop(TIME)
    if len(times) < 2 or not (np.diff(times) >= LEAST_GAP).all():
        raise TableError(
            f"{name}: {TIME} must increase by {LEAST_GAP:g} s or more from row to row, in two rows "
            "or more"
        )
    values = np.stack([columns.get(k, np.zeros_like(times)) for k in COLUMNS], axis=1)
    spline = CubicSpline(times, values, bc_type="clamped")
    return lambda time: spline(np.clip(time, times[0], times[-1]))


def _read(name: str) -> dict[str, np.ndarray]:
    """Returns the columns of a table by name."""
    try:
        with open(name, newline="", encoding="utf-8-sig") as file:
            heads, *rows = list(csv.reader(file)) or [[]]
        values = np.array([[float(cell) for cell in row] for row in rows if row], float)
    except OSError as error:
        raise TableError(f"{name}: cannot be read: {error.strerror}") from None
    except (ValueError, csv.Error) as error:
        raise TableError(f"{name}: is not a table of numbers: {error}") from None
    heads = [head.strip() for head in heads]
    for head in heads:
        if head not in (TIME, *COLUMNS):
            raise TableError(
                f"{name}: unknown column {head!r}; {did_you_mean(head, (TIME, *COLUMNS))}"
            )
    if TIME not in heads or values.ndim != 2 or values.shape[1] != len(heads):
        raise TableError(f"{name}: needs a column {TIME} and a number in each cell")
    if not (np.abs(values) <= LARGEST).all():
        raise TableError(f"{name}: holds numbers that are not finite, or beyond {LARGEST:g}")
    return dict(zip(heads, values.T, strict=True))


def check_motion(scene: Scene) -> None:
    """Raises SceneError for a motion that is not defined over the duration."""
    for k, motion in enumerate(scene.motion):
        key = f"motion.{k}"
        require(any(motion.axis), f"{key}.axis", "has no direction")
        if motion.table is None:
            check_formulas(motion, scene.duration, key)
            continue
        both = any((*motion.displacement, motion.angle))
        require(not both, key, "give either a table, or displacement and angle")
        with explaining(f"{key}.table"):
            table_numbers(motion.table)
    if scene.motion:
        _check_speed(scene)


def _check_speed(scene: Scene) -> None:
    """Raises SceneError if the corners of the tank are faster than MAX_SPEED within the duration;
    where the velocity jumps, the motion within INTERVAL counts."""
    path, reach = box_path(scene), 0.5 * math.hypot(*scene.box.size)
    for time in np.linspace(0.0, scene.duration, TRIALS).tolist():
        (before, turned), (after, turned_on) = path(time), path(time + INTERVAL)
        turn = float(np.linalg.norm(turned_on - turned)) / math.sqrt(2.0)
        speed = (float(np.linalg.norm(after - before)) + reach * turn) / INTERVAL
        problem = f"the tank moves at {speed:.3g} m/s at t = {time:.3g} s; {TOO_FAST}"
        require(speed <= MAX_SPEED, "motion", problem)


def check_formulas(given: TankMotion | BodyEntry, duration: float, key: str) -> None:
    """Raises SceneError for expressions that are not defined over the duration [s]."""
    parts = {f"{key}.displacement.{i}": f for i, f in enumerate(given.displacement)}
    for name, formula in {**parts, f"{key}.angle": given.angle}.items():
        with explaining(name):
            over(duration, OverTime(formula, duration))


def over(duration: float, found: Callable[[float], float]) -> list[float]:
    """Returns the values of a function at TRIALS times within the duration [s]."""
    return [found(time) for time in np.linspace(0.0, duration, TRIALS).tolist()]
