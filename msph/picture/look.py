"""Rendering parameters."""

from typing import Annotated

import numpy as np
from pydantic import Field

from msph.parameter import Section, Vector, parameter
from msph.picture.tone import linear

# A display-referred colour, sRGB.
Part = Annotated[float, Field(strict=True, ge=0.0, le=1.0)]
Colour = Annotated[tuple[Part, Part, Part], Field(strict=False)]


class Look(Section):
    """How the water is rendered."""

    view: str = parameter(
        "water", text="water, layers, speed, pressure, density_error, depth, particles"
    )
    sun_azimuth: float = parameter(
        161.6, ge=-360.0, le=360.0, unit="deg", text="direction of the sun, as camera.azimuth"
    )
    sun_elevation: float = parameter(
        43.5, ge=5.0, le=90.0, unit="deg", text="elevation of the sun above the horizon"
    )
    background: Colour | None = parameter(
        None, text="colour behind the pool, sRGB from 0 to 1; default: sky and ground"
    )
    background_top: Colour | None = parameter(
        None, text="colour at the top of the image, for a gradient; default: background"
    )
    alpha: bool = parameter(
        False, text="record images with an alpha channel, transparent where the background shows"
    )
    caustics: bool = parameter(True, text="light focused on the floor by waves")
    caustic_contrast: float = parameter(
        1.0,
        ge=0.0,
        le=1.0,
        text="contrast of caustics, 1: physical",
        label="caustics",
        live=(0.0, 1.0),
    )
    whitewater: bool = parameter(
        True, text="spray, foam and bubbles where the water splashes; they do not act on the water"
    )
    ripples: bool = parameter(
        True,
        text="small ripples where a hand or drops disturb the surface, waves and bubbles on water "
        "in the air; in the image only",
    )
    drying: float = parameter(
        8.0, ge=0.0, le=600.0, unit="s", text="time in which wet walls and bodies dry, 0: never wet"
    )
    refractive_index: float = parameter(
        1.333,
        ge=1.0,
        le=2.5,
        text="of water relative to air, 1: no refraction",
        label="refraction",
        live=(1.0, 1.6),
    )
    reflection: float = parameter(
        1.0,
        ge=0.0,
        le=1.0,
        text="strength of reflections, 1: physical",
        label="reflections",
        live=(0.0, 1.0),
    )
    # With 4, pools of 1 m look deep.
    tint: float = parameter(
        4.0,
        ge=0.0,
        le=100.0,
        text="strength of the water's colour, 1: clear water",
        label="colour of the water",
        live=(0.0, 20.0),
    )
    absorption: Vector = parameter(
        (0.42, 0.075, 0.035), unit="1/m", text="absorption by the water, RGB"
    )
    scatter: Vector = parameter((0.02, 0.18, 0.28), text="colour of deep water, linear RGB")
    supersample: int = parameter(
        1, ge=1, le=4, text="rays per pixel along each axis; capture: 2 by default"
    )
    legend: bool = parameter(True, text="show a legend of the colours of a view")

    def background_colours(self):
        """Returns the linear background colours at the bottom and top of the image, or None."""
        low, high = self.background or self.background_top, self.background_top or self.background
        return None if low is None else (linear(low), linear(high))

    def sun_direction(self):
        """Returns the unit vector to the sun, world frame."""
        a, e = np.radians((self.sun_azimuth, self.sun_elevation))
        return np.array((np.cos(e) * np.sin(a), np.sin(e), np.cos(e) * np.cos(a)))
