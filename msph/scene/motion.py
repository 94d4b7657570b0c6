"""Motion of the tank: expressions, tables and the sway as one path over time."""

import csv
import functools
import math
from collections.abc import Callable

import numpy as np

from msph.errors import did_you_mean
from msph.expressions import ExpressionError, OverTime
from msph.fluid.boundary.rigid_bodies import rotations
from msph.fluid.moving_box import Path, at_rest
from msph.scene.errors import SceneError
from msph.scene.schema import Body, Motion, Scene, Sway

# Columns of a motion table: the time, and the displacement and angle.
TIME, COLUMNS = "time_s", ("x_m", "y_m", "z_m", "angle_deg")
# Number of times over the duration at which expressions are checked.
TRIALS = 500
# Displacement [m] and angle [deg] of a motion at a time [s], (4,).
Numbers = Callable[[float], np.ndarray]

# Number of poses that a path caches, since consecutive steps need poses at the same times.
PLACES = 16


class TableError(ValueError):
    """A table of a motion that cannot be used; str() is one line."""


def box_path(scene: Scene) -> Path:
    """Returns the path of the box of a checked scene."""
    home = 0.5 * np.array(scene.box.size)
    parts = []
    if scene.sway.angle:
        height = home[1] if scene.sway.height is None else scene.sway.height
        parts.append((sway_numbers(scene.sway), Motion(centre=(home[0], height, home[2]))))
    parts += [(numbers(motion), motion) for motion in scene.motion]
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


def numbers(motion: Motion) -> Numbers:
    """Returns the displacement and angle of a motion. Raises ExpressionError, TableError."""
    if motion.table is not None:
        return table_numbers(motion.table)
    return formula_numbers(motion)


def formula_numbers(given: Motion | Body) -> Numbers:
    """Returns the displacement and angle by the expressions of a motion or body. Raises
    ExpressionError."""
    parts = [OverTime(formula) for formula in (*given.displacement, given.angle)]
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
    if len(times) < 2 or not (np.diff(times) > 0.0).all():
        raise TableError(f"{name}: {TIME} must increase over two rows or more")
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
    if not np.isfinite(values).all():
        raise TableError(f"{name}: holds numbers that are not finite")
    return dict(zip(heads, values.T, strict=True))


def check_motion(scene: Scene, where: str) -> None:
    """Raises SceneError for a motion that is not defined over the duration."""
    for k, motion in enumerate(scene.motion):
        key = f"motion.{k}"
        if not any(motion.axis):
            raise SceneError(where, "has no direction", f"{key}.axis")
        if motion.table is not None:
            if any((*motion.displacement, motion.angle)):
                raise SceneError(where, "give either a table, or displacement and angle", key)
            try:
                table_numbers(motion.table)
            except TableError as error:
                raise SceneError(where, str(error), f"{key}.table") from None
        check_formulas(motion, scene.duration, where, key)


def check_formulas(given: Motion | Body, duration: float, where: str, key: str) -> None:
    """Raises SceneError for expressions that are not defined over the duration [s]."""
    for i, formula in enumerate(given.displacement):
        values_over_time(formula, duration, where, f"{key}.displacement.{i}")
    values_over_time(given.angle, duration, where, f"{key}.angle")


def values_over_time(
    formula: float | str, duration: float, where: str, key: str
) -> list[tuple[float, float]]:
    """Returns TRIALS pairs of a time [s] within the duration [s] and an expression's value then.
    Raises SceneError if a value is not finite."""
    try:
        found = OverTime(formula)
    except ExpressionError as error:
        raise SceneError(where, str(error), key) from None
    values = [(time, found(time)) for time in np.linspace(0.0, duration, TRIALS).tolist()]
    for time, value in values:
        if not math.isfinite(value):
            raise SceneError(where, f"{formula!r} is not a number at t = {time:.3g} s", key)
    return values
