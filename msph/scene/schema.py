"""Every parameter of a scene, declared once: default, range, unit and help.

From these declarations come the strict schema, `--set`, `msph scenes --parameters`, the written
scene beside a capture, and the names in error messages. SI units; y is up; the box's min corner
is the origin.
"""

from typing import Annotated, Literal

from pydantic import Field

from msph.fluid.adaptivity.bands import AdaptationParameters
from msph.fluid.classic import ClassicParameters
from msph.fluid.methods import METHODS
from msph.fluid.projection.parameters import ProjectionParameters
from msph.parameter import Number, Section, Vector, parameter
from msph.picture.look import Look

# Edges of a box [m]: beyond these single precision cannot place particles.
Edge = Annotated[float, Field(strict=True, ge=1e-3, le=1e4)]
Size = Annotated[tuple[Edge, Edge, Edge], Field(strict=False)]
Place = Annotated[tuple[Number, Number], Field(strict=False)]


class Box(Section):
    """The pool."""

    size: Size = parameter(unit="m", text="inner edge lengths along x, y (up) and z")
    restitution: float = parameter(
        0.0, ge=0.0, le=1.0, text="share of the speed that a wall gives back"
    )


class Layer(Section):
    """A particle size. Give its mass or its spacing; one follows from the other."""

    mass: float | None = parameter(None, gt=1e-12, le=1e9, unit="kg", text="mass of one particle")
    spacing: float | None = parameter(
        None, gt=1e-5, le=1e3, unit="m", text="edge of the cube that one particle fills at rest"
    )
    smoothing: float | None = parameter(
        None,
        ge=1.2,
        le=4.0,
        text="support radius over spacing, h/d, where kernels vanish; default: "
        + ", ".join(f"{s.SMOOTHING:g} in {name}" for name, s in METHODS.items()),
    )
    gravity_factor: float = parameter(
        1.0, ge=0.0, le=1.0, text="share of gravity that the layer feels (thesis: less if finer)"
    )
    viscosity: float | None = parameter(
        None, ge=0.0, unit="Pa s", text="own dynamic viscosity in place of classic.viscosity"
    )
    kernels: Literal["mueller", "wendland"] = parameter(
        "mueller", text="poly6 and spiky (Mueller 2003), or Wendland C2 for both"
    )

    def mass_at(self, density: float) -> float:
        """Mass of a particle [kg], given or from the spacing at that rest density [kg/m^3]."""
        if self.mass is not None:
            return self.mass
        return density * (self.spacing or 0.0) ** 3


# Options of a layer that only some methods heed.
LAYER_OPTIONS = ("gravity_factor", "viscosity", "kernels")


class Water(Section):
    """A body of water: a box from lo to hi, or a ball, filled with one layer."""

    layer: int = parameter(0, ge=0, text="index into layers")
    lo: Vector | None = parameter(None, unit="m", text="lower corner of a box of water")
    hi: Vector | None = parameter(None, unit="m", text="upper corner of a box of water")
    centre: Vector | None = parameter(None, unit="m", text="centre of a ball of water")
    radius: float | None = parameter(None, gt=0.0, unit="m", text="radius of a ball of water")
    count: int | None = parameter(
        None, gt=0, text="exact number of particles, laid from the bottom; default: by volume"
    )
    velocity: Vector = parameter((0.0, 0.0, 0.0), unit="m/s", text="initial velocity")
    jitter: float = parameter(
        0.02, ge=0.0, le=0.5, text="random shift of the initial lattice, in spacings"
    )


class Placed(Section):
    """A mesh and where it stands."""

    scale: float = parameter(1.0, gt=0.0, le=1e6, unit="m", text="length of the mesh file's unit")
    rotation: Vector = parameter(
        (0.0, 0.0, 0.0), unit="deg", text="turns of the mesh about x, then y, then z"
    )
    position: Vector = parameter(
        (0.0, 0.0, 0.0), unit="m", text="where the mesh file's origin comes to be"
    )


class Container(Placed):
    """A closed mesh that holds the water in place of the box's walls."""

    mesh: str = parameter(text="file (.obj .ply .stl), beside the scene file or shipped")


class Obstacle(Placed):
    """A body in the water: a box from lo to hi, a ball, or a closed mesh; at rest or moving.

    What stands on the floor or against a wall should be sunk into it; boxes that touch are.
    """

    lo: Vector | None = parameter(None, unit="m", text="lower corner of a box")
    hi: Vector | None = parameter(None, unit="m", text="upper corner of a box")
    centre: Vector | None = parameter(None, unit="m", text="centre of a ball")
    radius: float | None = parameter(None, gt=0.0, unit="m", text="radius of a ball")
    mesh: str | None = parameter(
        None, text="file (.obj .ply .stl), beside the scene file or shipped"
    )
    velocity: Vector = parameter((0.0, 0.0, 0.0), unit="m/s", text="steady velocity")
    swing: Vector = parameter(
        (0.0, 0.0, 0.0), unit="m", text="way to the far end of a swing to and fro"
    )
    period: float = parameter(1.0, gt=0.0, unit="s", text="time of a swing there and back")
    axis: Vector = parameter((0.0, 1.0, 0.0), text="direction of the axis, through its middle")
    spin: float = parameter(0.0, unit="deg/s", text="speed of turning about the axis")


class Sway(Section):
    """The pool rocks by itself at the start: gravity turns in its frame."""

    angle: float = parameter(0.0, ge=0.0, le=45.0, unit="deg", text="largest tilt, 0: off")
    period: float = parameter(2.0, gt=0.0, unit="s", text="time of one swing")
    seconds: float = parameter(4.0, ge=0.0, unit="s", text="how long it lasts")


class Camera(Section):
    """Where the picture is seen from: an orbit around the middle of the box."""

    azimuth: float = parameter(30.0, ge=-360.0, le=360.0, unit="deg", text="turn about y")
    elevation: float = parameter(21.0, ge=3.0, le=88.0, unit="deg", text="height over the horizon")
    zoom: float = parameter(1.0, ge=0.25, le=2.8, text="1 shows the whole box, 2 half of it")
    fov: float = parameter(41.0, ge=10.0, le=90.0, unit="deg", text="vertical angle of view")


class Surface(Section):
    """The mesh drawn through the water by marching cubes."""

    cell: float = parameter(
        0.75, ge=0.2, le=2.0, text="edge of a cell, in spacings of the finest layer"
    )
    smoothing: float = parameter(
        1.0, ge=1.0, le=3.0, text="radius of the surface's kernel, in supports h"
    )


class Play(Section):
    """What keys and mouse do."""

    tilt_limit: float = parameter(35.0, ge=0.0, le=80.0, unit="deg", text="largest tilt of the box")
    tilt_rate: float = parameter(60.0, gt=0.0, unit="deg/s", text="speed of tilting by arrow keys")
    level: bool = parameter(True, text="the box comes level again when no key tilts it")
    push_radius: float = parameter(
        0.15,
        gt=0.0,
        le=1.0,
        text="radius of the pushing hand, in box lengths",
        live=(0.05, 0.5),
    )
    push_grip: float = parameter(
        20.0,
        gt=0.0,
        unit="1/s",
        text="how fast water takes the hand's velocity",
        live=(1.0, 60.0),
    )
    hover: bool = parameter(True, text="a cursor over the water leaves a wake without a click")
    idle: bool = parameter(True, text="the box sways when nobody has done anything for a while")
    speed: float = parameter(
        1.0,
        ge=0.01,
        le=10.0,
        text="simulated over wall-clock time that is asked for",
        live=(0.05, 2.0),
    )
    scale: float = parameter(
        1.0,
        ge=0.5,
        le=1.0,
        text="largest scale of the picture's edges, which shrink to hold the frame rate",
        live=(0.5, 1.0),
    )
    fps: float = parameter(
        60.0,
        ge=30.0,
        le=240.0,
        unit="1/s",
        text="frames per second to hold: the picture grows coarser first, time slows last",
    )


class Probe(Section):
    """An instrument in the water, read by `msph measure`: give what its kind needs."""

    name: str = parameter(
        pattern=r"^[A-Za-z0-9_.-]+$", text="letters, digits, _ . -: its column in probes.csv"
    )
    kind: Literal["pressure", "velocity", "height", "front", "flux", "force"] = parameter(
        text="what it reads"
    )
    point: Vector | None = parameter(
        None, unit="m", text="pressure, velocity: where, in the water or on a wall"
    )
    lo: Vector | None = parameter(
        None, unit="m", text="flux, mean pressure: corner of a rectangle across one axis"
    )
    hi: Vector | None = parameter(None, unit="m", text="the opposite corner")
    window: float = parameter(
        0.0, ge=0.0, le=10.0, unit="s", text="pressure: time over which readings are averaged"
    )
    body: str | None = parameter(
        None,
        pattern=r"^(container|obstacles\.[0-9]+)$",
        text="force: on which body, such as obstacles.0, and its torque",
    )
    at: Place | None = parameter(None, unit="m", text="height: x and z of the column of water")
    axis: Literal["+x", "-x", "+y", "-y", "+z", "-z"] | None = parameter(
        None, text="front: how far the connected water reaches in this direction"
    )


class Measure(Section):
    """How often `msph measure` looks."""

    every: float = parameter(
        1.0 / 60.0, gt=0.0, le=10.0, unit="s", text="time between rows of ledger and probes"
    )
    survey: float = parameter(
        0.1, ge=0.0, unit="s", text="time between surveys of volume and bulk density, 0: none"
    )


class Scene(Section):
    """A scene file."""

    title: str = parameter("", text="one line that says what is to be seen")
    source: str = parameter("", text="where the set-up comes from, or its purpose")
    method: Literal["classic", "projection"] = parameter(
        "projection", text="the solver: the thesis's, or the incompressible, conserving one"
    )
    density: float = parameter(
        1000.0, ge=1.0, le=1e5, unit="kg/m^3", text="rest density of the water"
    )
    gravity: Vector = parameter((0.0, -9.81, 0.0), unit="m/s^2", text="gravity", live=(0.01, 30.0))
    duration: float = parameter(10.0, gt=0.0, unit="s", text="simulated time of a capture or bench")
    seed: int = parameter(0, ge=0, text="seed of the initial jitter")
    box: Box = parameter(text="the pool")
    layers: list[Layer] = parameter(min_length=1, max_length=16, text="the particle sizes")
    water: list[Water] = parameter(min_length=1, text="the bodies of water")
    obstacles: list[Obstacle] = parameter(list, max_length=64, text="bodies in the water")
    container: Container | None = parameter(
        None, text="a mesh that holds the water; the box should enclose it"
    )
    projection: ProjectionParameters = parameter(
        ProjectionParameters, text="constants of the projection method"
    )
    adaptation: AdaptationParameters = parameter(
        AdaptationParameters, text="layers that follow the surface"
    )
    classic: ClassicParameters = parameter(
        ClassicParameters, text="constants and switches of the classic method"
    )
    sway: Sway = parameter(Sway, text="rocking at the start")
    camera: Camera = parameter(Camera, text="point of view")
    surface: Surface = parameter(Surface, text="quality of the surface")
    picture: Look = parameter(Look, text="look of the picture")
    play: Play = parameter(Play, text="keys and mouse")
    probes: list[Probe] = parameter(list, text="instruments in the water")
    measure: Measure = parameter(Measure, text="how often it is measured")
