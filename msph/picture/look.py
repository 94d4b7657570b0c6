"""What the picture may be asked to look like: one declaration per choice, with its unit."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Look:
    sun_azimuth: float = 2.82  # where the sun stands, as the camera's azimuth [rad]
    sun_elevation: float = 0.76  # [rad]
    absorption: tuple[float, float, float] = (0.42, 0.075, 0.035)  # clear water, RGB [1/m]
    tint: float = 4.0  # multiplies absorption: metre-sized pools shall look like deep ones
    scatter: tuple[float, float, float] = (0.02, 0.18, 0.28)  # colour of deep water, linear RGB
    tile: float = 1 / 12  # tile edge, as a share of the longest box edge
    caustics: bool = True  # light focused by the waves on floor and walls
    caustic_cells: int = 128  # resolution of their map along each side
    supersample: int = 1  # rays per pixel along each axis: 2 for capture

    def sun_direction(self):
        """Unit vector to the sun, world frame."""
        a, e = self.sun_azimuth, self.sun_elevation
        return np.array((np.cos(e) * np.sin(a), np.sin(e), np.cos(e) * np.cos(a)))
