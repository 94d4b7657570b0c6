"""Sections of a scene that do not act on the water: camera, surface mesh, interaction, probes."""

from typing import Annotated, Literal

from pydantic import Field

from msph.parameter import Number, Section, Vector, parameter

Place = Annotated[tuple[Number, Number], Field(strict=False)]


class Orbit(Section):
    """A direction from which the camera looks at a point. The camera may be under water."""

    azimuth: float = parameter(30.0, ge=-360.0, le=360.0, unit="deg", text="angle about the y axis")
    elevation: float = parameter(
        21.0,
        ge=-80.0,
        le=88.0,
        unit="deg",
        text="angle above horizontal; the camera stays above the ground",
    )
    zoom: float = parameter(
        1.0, ge=0.25, le=40.0, text="magnification: the whole box fits into the image at 1"
    )
    target: Vector | None = parameter(
        None, unit="m", text="point that the camera looks at; default: the centre of the box"
    )


class KeyFrame(Orbit):
    """A key frame of the camera's path."""

    time: float = parameter(
        ge=0.0, unit="s", text="simulated time; later than the key frame before"
    )


class Camera(Orbit):
    """The camera, on an orbit around its target."""

    fov: float = parameter(41.0, ge=10.0, le=90.0, unit="deg", text="vertical field of view")
    path: list[KeyFrame] = parameter(
        list, text="key frames of the camera in recordings: none, or two and more"
    )


class Surface(Section):
    """The water's surface mesh, built by marching cubes."""

    cell: float = parameter(
        0.75, ge=0.2, le=2.0, text="edge of a marching-cubes cell, in spacings of the finest layer"
    )
    smoothing: float = parameter(
        1.6, ge=1.0, le=3.0, text="radius of the surface's kernel, in supports h"
    )


class Play(Section):
    """Interaction by keys and mouse, and frame rate."""

    tilt_limit: float = parameter(35.0, ge=0.0, le=80.0, unit="deg", text="largest tilt of the box")
    tilt_rate: float = parameter(
        60.0, gt=0.0, unit="deg/s", text="angular velocity of tilting by arrow keys"
    )
    level: bool = parameter(True, text="return the box to level while no key tilts it")
    push_radius: float = parameter(
        0.25,
        gt=0.0,
        le=1.0,
        text="radius around the cursor within which water is pushed, over the root of the box's "
        "length times width",
        label="size of the hand",
        live=(0.05, 0.5),
    )
    push_grip: float = parameter(
        60.0,
        gt=0.0,
        unit="1/s",
        text="rate at which pushed water approaches the cursor's velocity",
        label="grip of the hand",
        live=(1.0, 120.0),
    )
    push_gain: float = parameter(
        1.6,
        gt=0.0,
        le=10.0,
        text="velocity of pushed water over the cursor's",
        live=(0.5, 4.0),
    )
    hover: bool = parameter(True, text="push the water under the cursor without a click")
    idle: bool = parameter(True, text="sway the box after some time without input")
    speed: float = parameter(
        1.0,
        ge=0.01,
        le=10.0,
        text="requested real-time factor",
        label="speed of time",
        live=(0.05, 2.0),
    )
    scale: float = parameter(
        1.0,
        ge=0.6,
        le=1.0,
        text="largest render scale; the scale decreases to hold the frame rate",
        label="sharpness of the image",
        live=(0.6, 1.0),
    )
    fps: float = parameter(
        60.0,
        ge=30.0,
        le=240.0,
        unit="1/s",
        text="frame rate to hold: resolution decreases first, simulation speed last",
    )


class Probe(Section):
    """A measuring point, face or column of `msph measure`; the kind determines the other keys."""

    name: str = parameter(
        pattern=r"^[A-Za-z0-9_.-]+$", text="column name in probes.csv: letters, digits, _ . -"
    )
    kind: Literal["pressure", "velocity", "height", "front", "flux", "force"] = parameter(
        text="measured quantity"
    )
    point: Vector | None = parameter(
        None, unit="m", text="pressure, velocity: position in the water or on a wall"
    )
    lo: Vector | None = parameter(
        None, unit="m", text="flux, mean pressure: lower corner of a rectangle normal to an axis"
    )
    hi: Vector | None = parameter(
        None, unit="m", text="flux, mean pressure: upper corner of the rectangle"
    )
    window: float = parameter(
        0.0, ge=0.0, le=10.0, unit="s", text="pressure: averaging time of the readings"
    )
    body: str | None = parameter(
        None, text="force and torque: name of the body, or its key, such as bodies.0"
    )
    at: Place | None = parameter(None, unit="m", text="height: x and z of the column of water")
    axis: Literal["+x", "-x", "+y", "-y", "+z", "-z"] | None = parameter(
        None, text="front: direction in which the farthest connected water is sought"
    )


class Measure(Section):
    """Intervals of `msph measure`."""

    every: float = parameter(
        1.0 / 60.0, ge=1e-6, le=10.0, unit="s", text="time between rows of ledger and probes"
    )
    survey: float = parameter(
        0.1, ge=0.0, unit="s", text="time between measurements of volume and bulk density, 0: none"
    )
