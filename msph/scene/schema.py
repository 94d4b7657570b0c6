"""Schema of a scene: every parameter with default, range, unit and help text.

Input checks, `--set`, `msph scenes --parameters`, the scene file written by a capture and the keys
in error messages are derived from it. SI units; y is up; the origin is the box's lower corner.
"""

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field

from msph.fluid.adaptivity.bands import AdaptationParameters
from msph.fluid.boundary.rigid_bodies import FRICTION
from msph.fluid.classic_parameters import ClassicParameters
from msph.fluid.methods import METHODS
from msph.fluid.projection.parameters import ProjectionParameters
from msph.parameter import LONGEST, SHORTEST, Number, Section, Vector, parameter
from msph.picture.look import Colour, Look
from msph.scene.observation import Camera, Measure, Play, Probe, Surface

# Edge of a box [m]; single precision cannot resolve positions beyond this range.
Edge = Annotated[float, Field(strict=True, ge=1e-3, le=1e4)]
Size = Annotated[tuple[Edge, Edge, Edge], Field(strict=False)]
# A number, or an expression of the time t [s].
Timed = Number | str
Displacement = Annotated[tuple[Timed, Timed, Timed], Field(strict=False)]


class Box(Section):
    """The pool."""

    size: Size = parameter(unit="m", text="inner edge lengths along x, y (up) and z")
    restitution: float = parameter(
        0.0, ge=0.0, le=1.0, text="rebound speed over impact speed at a wall"
    )
    open: bool = parameter(
        False, text="no lid: water above the rim falls outside and leaves the simulation"
    )


class Layer(Section):
    """A particle size, given by mass or by spacing."""

    mass: float | None = parameter(None, gt=1e-12, le=1e9, unit="kg", text="mass of one particle")
    spacing: float | None = parameter(
        None, gt=1e-5, le=1e3, unit="m", text="edge of the cube of one particle's rest volume"
    )
    smoothing: float | None = parameter(
        None,
        ge=1.2,
        le=4.0,
        text="support radius of the kernels over spacing, h/d; default: "
        + ", ".join(f"{s.SMOOTHING:g} in {name}" for name, s in METHODS.items()),
    )
    gravity_factor: float = parameter(
        1.0, ge=0.0, le=1.0, text="factor of gravity in this layer (thesis: smaller if finer)"
    )
    viscosity: float | None = parameter(
        None,
        ge=0.0,
        le=1e4,
        unit="Pa s",
        text="dynamic viscosity; default: classic.viscosity",
    )
    kernels: Literal["mueller", "wendland"] = parameter(
        "mueller", text="kernels: poly6 and spiky (Mueller et al. 2003), or Wendland C2 for both"
    )

    def mass_at(self, density: float) -> float:
        """Returns the mass of a particle [kg] at a rest density [kg/m^3]."""
        if self.mass is not None:
            return self.mass
        return density * (self.spacing or 0.0) ** 3


# Options of a layer that only some methods use.
LAYER_OPTIONS = ("gravity_factor", "viscosity", "kernels")


class Water(Section):
    """A volume of water, filled with one layer: a box from lo to hi, or a ball."""

    layer: int = parameter(0, ge=0, text="index of the layer, from 0")
    lo: Vector | None = parameter(None, unit="m", text="lower corner of a box of water")
    hi: Vector | None = parameter(None, unit="m", text="upper corner of a box of water")
    centre: Vector | None = parameter(None, unit="m", text="centre of a ball of water")
    radius: float | None = parameter(None, gt=0.0, unit="m", text="radius of a ball of water")
    count: int | None = parameter(
        None, gt=0, text="exact number of particles, from the bottom up; default: by volume"
    )
    velocity: Vector = parameter((0.0, 0.0, 0.0), unit="m/s", text="initial velocity")
    jitter: float = parameter(
        0.02, ge=0.0, le=0.5, text="range of random initial displacements, in spacings"
    )


class Placed(Section):
    """Scale, rotation and position of a mesh."""

    scale: float = parameter(1.0, gt=0.0, le=1e6, unit="m", text="length of the mesh file's unit")
    rotation: Vector = parameter(
        (0.0, 0.0, 0.0), unit="deg", text="angles of rotation about x, then y, then z"
    )
    position: Vector = parameter(
        (0.0, 0.0, 0.0), unit="m", text="position of the mesh file's origin"
    )


class Container(Placed):
    """A closed mesh that contains the water, instead of the box's walls."""

    mesh: str = parameter(text="mesh file (.obj .ply .stl): next to the scene file, or shipped")


class BodyEntry(Placed):
    """A body: a box from lo to hi, a ball, or a closed mesh.

    With density or mass it floats; otherwise it is fixed or in prescribed motion.
    """

    name: str = parameter(
        "", pattern=r"^[A-Za-z0-9_-]*$", text="name in tables and scripts; default: bodies.0, ..."
    )
    lo: Vector | None = parameter(None, unit="m", text="lower corner of a box")
    hi: Vector | None = parameter(None, unit="m", text="upper corner of a box")
    centre: Vector | None = parameter(None, unit="m", text="centre of a ball")
    radius: float | None = parameter(None, gt=0.0, unit="m", text="radius of a ball")
    mesh: str | None = parameter(
        None, text="mesh file (.obj .ply .stl): next to the scene file, or shipped"
    )
    density: float | None = parameter(
        None, gt=0.0, le=1e6, unit="kg/m^3", text="density of a floating body"
    )
    mass: float | None = parameter(
        None, gt=0.0, le=1e12, unit="kg", text="mass of a floating body, instead of its density"
    )
    velocity: Vector = parameter(
        (0.0, 0.0, 0.0), unit="m/s", text="constant velocity; of a floating body, at the start"
    )
    swing: Vector = parameter(
        (0.0, 0.0, 0.0), unit="m", text="displacement at the far end of an oscillation"
    )
    period: float = parameter(1.0, ge=1e-6, le=LONGEST, unit="s", text="period of the oscillation")
    displacement: Displacement = parameter(
        (0.0, 0.0, 0.0),
        unit="m",
        text="instead of velocity and swing: numbers, or expressions of the time t [s]",
    )
    axis: Vector = parameter(
        (0.0, 1.0, 0.0), text="direction of the rotation axis, which passes through the centre"
    )
    angle: Timed = parameter(
        0.0,
        unit="deg",
        text="instead of spin: angle about the axis, a number or an expression of t",
    )
    spin: float = parameter(
        0.0,
        unit="deg/s",
        text="angular velocity about the axis; of a floating body, at the start",
    )
    release: float = parameter(
        0.0, ge=0.0, unit="s", text="time until which a floating body is held at rest"
    )
    friction: float = parameter(
        FRICTION, ge=0.0, le=10.0, text="coefficient of friction with walls and other bodies"
    )
    colour: Colour | None = parameter(
        None, text="colour, sRGB from 0 to 1; default: the colours of the mesh, or clay"
    )


class OpeningEntry(Section):
    """Cross-section of an inflow or outflow: a disc, or a rectangle normal to an axis."""

    centre: Vector | None = parameter(None, unit="m", text="centre of a disc")
    radius: float | None = parameter(None, gt=0.0, unit="m", text="radius of a disc")
    lo: Vector | None = parameter(None, unit="m", text="lower corner of a rectangle")
    hi: Vector | None = parameter(None, unit="m", text="upper corner of a rectangle")
    direction: Vector | None = parameter(
        None, text="direction of the flow; default: through the wall on which it lies, or down"
    )
    speed: Timed | None = parameter(
        None, unit="m/s", text="speed: a number, or an expression of the time t [s]"
    )
    rate: Timed | None = parameter(
        None, unit="L/s", text="flow, instead of the speed: a number or an expression of t"
    )


class Inflow(OpeningEntry):
    """An inflow: water that enters at a speed or rate, such as a tap, a jet or a spring."""

    layer: int | None = parameter(
        None, ge=0, text="layer of the new particles; default: by the depth at the start"
    )


class Outflow(OpeningEntry):
    """An outflow: a hole in a wall, or a cross-section in the box that removes water.

    If a speed or rate is given, the flow is prescribed; otherwise water leaves freely.
    """


class WaveMaker(Section):
    """A wave maker over the whole cross-section of the box at an end, and a beach opposite."""

    end: Literal["-x", "+x", "-z", "+z"] = parameter("-x", text="end of the box")
    kind: Literal["piston", "flap"] = parameter(
        "piston", text="moves to and fro, or swings about a hinge at the floor"
    )
    stroke: float = parameter(
        ge=1e-6, unit="m", text="way from end to end, of a flap at the height of the water"
    )
    period: float = parameter(ge=SHORTEST, le=1000.0, unit="s", text="period of the waves")
    ramp: float = parameter(
        1.0, ge=0.0, le=LONGEST, unit="s", text="time in which the stroke grows"
    )
    position: float | None = parameter(
        None,
        gt=0.0,
        unit="m",
        text="mean distance from the wall behind it; default: as near as possible",
    )
    beach: float = parameter(
        0.0, ge=0.0, unit="m", text="length of a zone at the other end that damps waves, 0: none"
    )


class TankMotion(Section):
    """A motion of the tank over time, by expressions or a table; motions are composed in order.

    The water starts at rest in the tank.
    """

    displacement: Displacement = parameter(
        (0.0, 0.0, 0.0), unit="m", text="displacement: numbers, or expressions of the time t [s]"
    )
    angle: Timed = parameter(
        0.0, unit="deg", text="angle of rotation: a number, or an expression of the time t [s]"
    )
    axis: Vector = parameter((0.0, 0.0, 1.0), text="direction of the rotation axis")
    centre: Vector | None = parameter(
        None, unit="m", text="point of the rotation axis; default: the centre of the box"
    )
    table: str | None = parameter(
        None,
        text="instead, a CSV file next to the scene file, with columns time_s and x_m, y_m, z_m, "
        "angle_deg",
    )


class Sway(Section):
    """Rocking of the tank at the start about a horizontal axis along z, a short motion. Water at
    the height of the axis is driven by the tilt alone; below it, inertia adds to the tilt."""

    angle: float = parameter(0.0, ge=0.0, le=45.0, unit="deg", text="amplitude of the tilt, 0: off")
    period: float = parameter(2.0, ge=SHORTEST, le=LONGEST, unit="s", text="period of the tilt")
    seconds: float = parameter(4.0, ge=0.0, le=LONGEST, unit="s", text="duration of the rocking")
    height: float | None = parameter(
        None, unit="m", text="height of the axis above the floor; default: half that of the box"
    )


def listed(given: Any) -> Any:
    """Returns a single table as a list."""
    return [given] if isinstance(given, dict) else given


class Scene(Section):
    """A scene file."""

    title: str = parameter("", text="title: what the scene shows, in one line")
    source: str = parameter("", text="source or purpose of the set-up")
    method: Literal["classic", "projection"] = parameter(
        "projection", text="solver: classic (the thesis's) or projection (incompressible)"
    )
    density: float = parameter(
        1000.0, ge=1.0, le=1e5, unit="kg/m^3", text="rest density of the water"
    )
    gravity: Vector = parameter(
        (0.0, -9.81, 0.0), unit="m/s^2", text="gravitational acceleration", live=(0.01, 30.0)
    )
    duration: float = parameter(
        10.0,
        gt=0.0,
        le=LONGEST,
        unit="s",
        text="simulated time of `msph capture`, `msph bench` and `msph measure`",
    )
    seed: int = parameter(0, ge=0, text="random seed of the initial displacements")
    box: Box = parameter(text="the pool")
    layers: list[Layer] = parameter(min_length=1, max_length=16, text="particle sizes")
    water: list[Water] = parameter(min_length=1, text="volumes of water")
    bodies: list[BodyEntry] = parameter(
        list, max_length=64, text="fixed, moving and floating bodies"
    )
    inflows: list[Inflow] = parameter(list, max_length=8, text="inflows")
    outflows: list[Outflow] = parameter(list, max_length=8, text="outflows")
    container: Container | None = parameter(
        None, text="closed mesh around the water; the box must enclose it"
    )
    projection: ProjectionParameters = parameter(
        ProjectionParameters, text="constants of the projection method"
    )
    adaptation: AdaptationParameters = parameter(
        AdaptationParameters, text="adaptation of the layers to the surface"
    )
    classic: ClassicParameters = parameter(
        ClassicParameters, text="constants and switches of the classic method"
    )
    wavemakers: list[WaveMaker] = parameter(list, max_length=4, text="wave makers and beaches")
    sway: Sway = parameter(Sway, text="rocking at the start")
    motion: Annotated[list[TankMotion], BeforeValidator(listed)] = parameter(
        list, max_length=8, text="motions of the tank"
    )
    camera: Camera = parameter(Camera, text="camera position")
    surface: Surface = parameter(Surface, text="resolution of the surface mesh")
    picture: Look = parameter(Look, text="appearance of the image")
    play: Play = parameter(Play, text="interaction and frame rate")
    probes: list[Probe] = parameter(list, text="probes")
    measure: Measure = parameter(Measure, text="intervals of measurement")
