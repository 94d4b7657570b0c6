"""Rendering parameters."""

import numpy as np

from msph.parameter import Section, Vector, parameter


class Look(Section):
    """How the water is rendered."""

    view: str = parameter(
        "water", text="water, layers, speed, pressure, density_error, depth, particles"
    )
    sun_azimuth: float = parameter(
        161.6, ge=-360.0, le=360.0, unit="deg", text="where the sun stands, as camera.azimuth"
    )
    sun_elevation: float = parameter(
        43.5, ge=5.0, le=90.0, unit="deg", text="height of the sun over the horizon"
    )
    caustics: bool = parameter(True, text="light gathered by the waves on the floor")
    caustic_contrast: float = parameter(
        1.0, ge=0.0, le=1.0, text="share of the caustics' contrast that is shown", live=(0.0, 1.0)
    )
    refractive_index: float = parameter(
        1.333, ge=1.0, le=2.5, text="of the water against air; 1: nothing is bent", live=(1.0, 1.6)
    )
    reflection: float = parameter(
        1.0, ge=0.0, le=1.0, text="share of the mirrored light that is shown", live=(0.0, 1.0)
    )
    # 4, not 1: metre-sized pools shall look like deep ones.
    tint: float = parameter(
        4.0,
        ge=0.0,
        le=100.0,
        text="strength of the water's colour, 1: real clear water",
        live=(0.0, 20.0),
    )
    absorption: Vector = parameter(
        (0.42, 0.075, 0.035), unit="1/m", text="light that the water takes up, red, green, blue"
    )
    scatter: Vector = parameter((0.02, 0.18, 0.28), text="colour of deep water, linear RGB")
    supersample: int = parameter(
        1, ge=1, le=4, text="rays per pixel along each axis: smoother edges"
    )
    legend: bool = parameter(True, text="say in the picture what the colours of a view mean")

    def sun_direction(self):
        """Unit vector to the sun, world frame."""
        a, e = np.radians((self.sun_azimuth, self.sun_elevation))
        return np.array((np.cos(e) * np.sin(a), np.sin(e), np.cos(e) * np.cos(a)))
