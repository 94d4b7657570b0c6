"""An opening: the cross-section of one inflow or outflow, as a scene or a user gives it."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from msph.fluid.particles.layers import LayerSpec

# Length of a zone [spacings]: more than a support, so that no kernel in the box reaches its end.
ZONE = 3.0
# Excess width of a zone over the opening [spacings], as rows of particles may overlap its edge.
SLACK = 0.5
# Width by which an opening is wider for images than it is [spacings], fitted to measured
# discharges: without it round holes of 3 to 4 spacings radius pass 6 % less water (docs/trials.md).
EDGE = 0.1
# Greatest distance [spacings] of an opening from the wall on which it lies, and least cosine of
# the angle between its direction and the normal of that wall.
ON_WALL, ALONG_NORMAL = 0.5, 0.999
# Largest distance [m] of a pipe beyond a wall that counts as rounding.
ROUNDING = 1e-6
# Time [s] that no simulation reaches.
LAST = 1e12


@dataclass
class Valve:
    """A speed [m/s] until a time [s], and 0 from then on."""

    speed: float
    until: float = LAST

    def __call__(self, time: float) -> float:
        """Returns the speed [m/s] at a time [s]."""
        return self.speed if time < self.until else 0.0


@dataclass(frozen=True, eq=False)
class Opening:
    """Cross-section around `centre` (3,) [m] through which water flows along `direction` (3,): a
    disc of radius half[0] [m], or a rectangle of half edges `half` [m] along the rows of `edges`
    (2, 3).

    enters: True for an inflow. speed [m/s] over time [s]; None for an outflow that water leaves
    freely. layer: of new particles, or of most water around an outflow.
    """

    centre: np.ndarray
    direction: np.ndarray
    half: tuple[float, float]
    enters: bool
    speed: Callable[[float], float] | None = None
    edges: np.ndarray | None = None
    layer: int = 0

    @property
    def area(self) -> float:
        """Area of the cross-section [m^2]."""
        return math.pi * self.half[0] ** 2 if self.edges is None else 4.0 * math.prod(self.half)

    @property
    def along(self) -> np.ndarray:
        """Unit vector (3,) of the flow."""
        return self.direction / np.linalg.norm(self.direction)

    @property
    def frame(self) -> np.ndarray:
        """Unit vectors (2, 3) that span the cross-section."""
        if self.edges is not None:
            return self.edges
        across = np.cross(self.along, np.eye(3)[int(np.argmin(np.abs(self.along)))])
        across /= np.linalg.norm(across)
        return np.stack([across, np.cross(self.along, across)])

    def wall(self, walls: np.ndarray, spacing: float) -> int:
        """Returns the wall on which the opening lies and to which its flow is normal, as a bit
        (Walls.near), or 0. walls (3,) [m]: the far walls; spacing [m]: of its
        layer."""
        outwards = -self.along if self.enters else self.along
        for k in range(3):
            for far, wall in enumerate((0.0, walls[k])):
                near = abs(self.centre[k] - wall) < ON_WALL * spacing
                if near and (2 * far - 1) * outwards[k] > ALONG_NORMAL:
                    return 1 << (k + 3 * far)
        return 0

    def problem(self, walls: np.ndarray, spacing: float) -> str | None:
        """Returns an error text if the opening, or the zone of an inflow that is on no wall, is not
        inside the box, otherwise None. walls, spacing: as in wall()."""
        ends = [self.centre]
        if self.enters and not self.wall(walls, spacing):
            ends.append(self.centre - ZONE * spacing * self.along)
        spread = np.abs(self.frame).T @ self.half
        if self.edges is None:
            spread = self.half[0] * np.sqrt(1.0 - self.along**2)
        lo, hi = np.min(ends, axis=0) - spread, np.max(ends, axis=0) + spread
        # The water of a pipe inside the box must not reach beyond a wall.
        edge = ON_WALL * spacing if len(ends) == 1 else ROUNDING
        if np.all(lo >= -edge) and np.all(hi <= walls + edge):
            return None
        what = (
            f", {ZONE:g} spacings of {spacing:.3g} m behind it included," if len(ends) > 1 else ""
        )
        reach = " to ".join("(" + ", ".join(f"{c:.3g}" for c in x) + ")" for x in (lo, hi))
        return f"reaches{what} from {reach} m, beyond the box"

    def row(self, spec: LayerSpec, walls: np.ndarray) -> dict[str, Any]:
        """Returns the row of the table `constants.openings`."""
        length, wall = ZONE * spec.spacing, self.wall(walls, spec.spacing)
        if self.speed is None:
            # A jet contracts and gains speed over about the width of its hole.
            length += 2.0 * min(self.half)
        centre = self.centre.copy()
        if wall:
            # Exactly on the wall: the pipe and the box then meet without a gap.
            k = int(np.argmax(np.abs(self.along)))
            centre[k] = walls[k] if wall >= 8 else 0.0
        pumps = not self.enters and self.speed is not None
        return {
            "centre": centre,
            "along": self.along,
            "across": self.frame[0],
            "aslant": self.frame[1],
            "width": self.half[0],
            "height": self.half[1],
            "round": self.edges is None,
            "wall": 0 if pumps else wall,
            "zone_begin": -length if self.enters else 0.0,
            "kept_from": -length - spec.spacing if self.enters else 0.0,
            "length": length + (2.0 * spec.spacing if self.enters else 0.0),
            "leaves": not self.enters and not pumps,
            "slack": SLACK * spec.spacing,
            "edge": EDGE * spec.spacing,
        }

    def sites(self, spec: LayerSpec) -> tuple[np.ndarray, float]:
        """Returns the sites (n, 3) [m] of a sheet relative to the centre, and the distance [m] of
        sheets."""
        d = spec.spacing
        if self.edges is None:
            # Rings: a square lattice would leave gaps at the edge.
            n, across = max(1, round(self.area / d**2)), self.half[0] / d
            found = [_rings(n, r) for r in {max(1, math.floor(across)), math.ceil(across)}]
            places = self.half[0] * max(found, key=_least_distance)
        else:
            axes = []
            for half in self.half:
                m = max(1, round(2.0 * half / d))
                axes.append(half * ((2.0 * np.arange(m) + 1.0) / m - 1.0))
            places = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
        return places @ self.frame, len(places) * spec.volume / self.area


def _rings(n: int, rings: int) -> np.ndarray:
    """Returns n points (n, 2) in the unit disc, evenly in rings of equal width."""
    ends = np.round(n * (np.arange(rings + 1) / rings) ** 2).astype(int)
    parts = []
    for ring, count in enumerate(np.diff(ends).tolist()):
        angle = 2.0 * np.pi * (np.arange(count) + 0.5 * ring) / max(count, 1)
        radius = (ring + 0.5) / rings * (count > 1)
        parts.append(radius * np.stack([np.cos(angle), np.sin(angle)], axis=1))
    return np.concatenate(parts)


def _least_distance(x: np.ndarray) -> float:
    """Returns the least distance between two of the points (n, 2)."""
    apart = np.linalg.norm(x[:, None] - x, axis=2) + np.where(np.eye(len(x)) > 0, np.inf, 0.0)
    return float(apart.min())
