"""Every parameter of a scene, declared once: default, range, unit and help.

From these declarations come the strict schema, `--set`, `msph scenes --parameters`, the written
scene beside a capture, and the names in error messages. SI units; y is up; the box's min corner
is the origin.
"""

from dataclasses import dataclass
from types import UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel, ConfigDict, Field

from msph.fluid.adaptation import AdaptationTerms
from msph.fluid.classic import ClassicTerms
from msph.fluid.projection_terms import ProjectionTerms
from msph.picture.look import Look


def parameter(default: Any = ..., *, unit: str = "-", text: str, **limits) -> Any:
    """A scene parameter; `...` as default makes it required. limits: gt, ge, lt, le, lengths."""
    if callable(default):
        return Field(
            default_factory=default, description=text, json_schema_extra={"unit": unit}, **limits
        )
    return Field(default, description=text, json_schema_extra={"unit": unit}, **limits)


class Section(BaseModel):
    """A table of a scene file. Unknown keys, other types, NaN and infinity are errors."""

    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)


Number = Annotated[float, Field(strict=True)]
# Edges of a box [m]: beyond these single precision cannot place particles.
Edge = Annotated[float, Field(strict=True, ge=1e-3, le=1e4)]
Vector = Annotated[tuple[Number, Number, Number], Field(strict=False)]
Size = Annotated[tuple[Edge, Edge, Edge], Field(strict=False)]
Place = Annotated[tuple[Number, Number], Field(strict=False)]

_terms, _project, _adapt, _look = ClassicTerms(), ProjectionTerms(), AdaptationTerms(), Look()


class Box(Section):
    """The pool."""

    size: Size = parameter(unit="m", text="inner edge lengths along x, y (up) and z")
    restitution: float = parameter(
        _terms.restitution, ge=0.0, le=1.0, text="share of the speed that a wall gives back"
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
        text="support radius over spacing, h/d, where kernels vanish; default: 2 in the classic "
        "method, 2.45 in projection",
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


class Water(Section):
    """A body of water: a box from lo to hi, or a ball, filled with one layer."""

    layer: int = parameter(0, ge=0, text="index into layers")
    lo: Vector | None = parameter(None, unit="m", text="lower corner of a box of water")
    hi: Vector | None = parameter(None, unit="m", text="upper corner of a box of water")
    centre: Vector | None = parameter(None, unit="m", text="centre of a ball of water")
    radius: float | None = parameter(None, gt=0.0, unit="m", text="radius of a ball of water")
    count: int | None = parameter(
        None, gt=0, text="exact number of particles, laid from the bottom; default: what fits"
    )
    velocity: Vector = parameter((0.0, 0.0, 0.0), unit="m/s", text="initial velocity")
    jitter: float = parameter(
        0.02, ge=0.0, le=0.5, text="random shift of the initial lattice, in spacings"
    )


class Placed(Section):
    """A mesh and where it stands."""

    scale: float = parameter(1.0, gt=0.0, unit="m", text="length of the mesh file's unit")
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


class Classic(Section):
    """The thesis's weakly compressible method (Gokdogan 2008)."""

    stiffness: float = parameter(
        _terms.stiffness,
        gt=0.0,
        le=1e7,
        unit="m^2/s^2",
        text="k of p = k (rho - rho0), the square of the speed of sound",
    )
    viscosity: float = parameter(10.0, ge=0.0, le=1e4, unit="Pa s", text="dynamic viscosity mu")
    tension: bool = parameter(
        _terms.tension, text="let pressures below zero pull, as the thesis's formula does"
    )
    pressure_form: Literal["mean", "squared", "product"] = parameter(
        "mean", text="pressure force: mean (27), or symmetrised: squared (32), product (33)"
    )
    viscosity_form: Literal["formula", "pseudocode"] = parameter(
        "formula", text="viscous force: formula (28), or the pseudo-code of A.2"
    )
    attraction: float = parameter(
        _terms.attraction, ge=0.0, unit="N/m", text="surface attraction by the colour term, 0: off"
    )
    colour_threshold: float = parameter(
        _terms.colour_threshold, gt=0.0, text="colour gradient times h above which it attracts"
    )
    courant: float = parameter(
        _terms.courant, ge=0.01, le=1.0, text="time step over the time sound takes to cross h"
    )


class Projection(Section):
    """The incompressible method: two pressure solves a step."""

    cfl: float = parameter(
        _project.cfl, gt=0.0, le=1.0, text="most spacings that a particle moves in a step"
    )
    pressure_cfl: float = parameter(
        _project.pressure_cfl,
        gt=0.0,
        le=2.0,
        text="most spacings that the speed sqrt(p/rho) covers in a step",
    )
    longest_step: float = parameter(
        _project.longest_step, gt=0.0, le=0.1, unit="s", text="longest time step of slow water"
    )
    release: float = parameter(
        _project.release, gt=0.0, unit="s", text="time in which a density excess becomes velocity"
    )
    tolerance: float = parameter(
        _project.tolerance,
        gt=0.0,
        lt=1.0,
        text="share of the pressure's displacements that the velocity solve may leave",
    )
    motion_tolerance: float = parameter(
        _project.motion_tolerance,
        ge=0.0,
        lt=1.0,
        text="or share of the way that the water goes in the step",
    )
    velocity_iterations: int = parameter(
        _project.velocity_iterations, ge=1, text="most iterations of the velocity solve"
    )
    position_iterations: int = parameter(
        _project.position_iterations, ge=0, text="iterations of the position solve"
    )
    largest_shift: float = parameter(
        _project.largest_shift, gt=0.0, le=1.0, text="most spacings of the position solve"
    )
    spray: float = parameter(
        _project.spray, ge=0.0, le=1.0, text="relative density below which water is spray"
    )
    viscosity: float = parameter(
        _project.viscosity,
        ge=0.0,
        le=1e5,
        unit="Pa s",
        text="dynamic viscosity, 0: off; water 0.001, honey 10",
    )
    slip: bool = parameter(
        _project.slip, text="the box does not brake viscous water; bodies never do"
    )
    tension: float = parameter(
        _project.tension,
        ge=0.0,
        le=1e3,
        unit="N/m",
        text="surface tension, 0: off; water 0.072",
    )
    xsph: float = parameter(
        _project.xsph,
        ge=0.0,
        le=0.5,
        text="share of the way to its neighbours' velocity that water takes in a step, 0: off",
    )


class Adaptation(Section):
    """Projection alone: particles split and merge, so that each depth has its layer."""

    enabled: bool = parameter(False, text="let particles change their layer with their depth")
    band: float = parameter(
        _adapt.band, ge=0.5, le=50.0, text="thickness of a layer's band, in its supports"
    )
    hysteresis: float = parameter(
        _adapt.hysteresis, ge=0.0, le=0.4, text="share of a band's bound that a particle must pass"
    )
    every: int = parameter(_adapt.every, ge=1, text="steps between passes, at least")
    travel: float = parameter(
        _adapt.travel, ge=0.0, text="spacings that the fastest particle goes between passes"
    )
    budget: float = parameter(
        _adapt.budget, gt=0.0, le=1.0, text="share of all particles that a pass may change"
    )
    settle: int = parameter(
        _adapt.settle, ge=0, text="times `every` steps that a particle waits until its next change"
    )
    capacity: int | None = parameter(
        None,
        gt=0,
        text="most particles; beyond, fine layers grow thinner. Default: all water at its finest, "
        "at most 30,000 or twice the particles at the start",
    )


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
    iso: float = parameter(0.5, gt=0.0, lt=1.0, text="coverage at which the surface lies")
    smoothing: float = parameter(
        1.0, ge=1.0, le=3.0, text="radius of the surface's kernel, in supports h"
    )


class Picture(Section):
    """How the water is drawn."""

    view: str = parameter(
        "water", text="water, layer, speed, density_error, or another particle attribute"
    )
    caustics: bool = parameter(_look.caustics, text="light gathered by the waves on the floor")
    tint: float = parameter(
        _look.tint, ge=0.0, le=100.0, text="strength of the water's colour, 1: real clear water"
    )
    absorption: Vector = parameter(
        _look.absorption, unit="1/m", text="light that the water takes up, red, green, blue"
    )
    scatter: Vector = parameter(_look.scatter, text="colour of deep water, linear RGB")
    supersample: int = parameter(
        _look.supersample, ge=1, le=4, text="rays per pixel along each axis: smoother edges"
    )


class Play(Section):
    """What keys and mouse do."""

    tilt_limit: float = parameter(35.0, ge=0.0, le=80.0, unit="deg", text="largest tilt of the box")
    tilt_rate: float = parameter(60.0, gt=0.0, unit="deg/s", text="speed of tilting by arrow keys")
    push_radius: float = parameter(
        0.15, gt=0.0, le=1.0, text="radius of the pushing hand, in box lengths"
    )
    push_grip: float = parameter(
        20.0, gt=0.0, unit="1/s", text="how fast water takes the hand's velocity"
    )
    budget: float = parameter(
        1.0 / 30.0,
        ge=0.0,
        unit="s",
        text="wall-clock time of the water per frame; time slows where it is short, 0: unlimited",
    )


class Probe(Section):
    """An instrument in the water, read by `msph measure`: give what its kind needs."""

    name: str = parameter(
        pattern=r"^[A-Za-z0-9_.-]+$", text="letters, digits, _ . -: its column in probes.csv"
    )
    kind: Literal["pressure", "height", "front"] = parameter(text="what it reads")
    point: Vector | None = parameter(
        None, unit="m", text="pressure: where, in the water or on a wall"
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
    gravity: Vector = parameter((0.0, -9.81, 0.0), unit="m/s^2", text="gravity")
    duration: float = parameter(10.0, gt=0.0, unit="s", text="simulated time of a capture or bench")
    seed: int = parameter(0, ge=0, text="seed of the initial jitter")
    box: Box = parameter(text="the pool")
    layers: list[Layer] = parameter(min_length=1, max_length=16, text="the particle sizes")
    water: list[Water] = parameter(min_length=1, text="the bodies of water")
    obstacles: list[Obstacle] = parameter(list, max_length=64, text="bodies in the water")
    container: Container | None = parameter(
        None, text="a mesh that holds the water; the box should enclose it"
    )
    projection: Projection = parameter(Projection, text="constants of the projection method")
    adaptation: Adaptation = parameter(Adaptation, text="layers that follow the surface")
    classic: Classic = parameter(Classic, text="constants and switches of the classic method")
    sway: Sway = parameter(Sway, text="rocking at the start")
    camera: Camera = parameter(Camera, text="point of view")
    surface: Surface = parameter(Surface, text="quality of the surface")
    picture: Picture = parameter(Picture, text="look of the picture")
    play: Play = parameter(Play, text="keys and mouse")
    probes: list[Probe] = parameter(list, text="instruments in the water")
    measure: Measure = parameter(Measure, text="how often it is measured")


@dataclass(frozen=True)
class Parameter:
    """One declared parameter: its dotted key, type, default, unit, range and help, in words."""

    key: str
    kind: str
    default: str
    unit: str
    limits: str
    text: str

    def row(self) -> dict[str, str]:
        return {
            "parameter": self.key,
            "type": self.kind,
            "default": self.default,
            "unit": self.unit,
            "range": self.limits,
            "": self.text,
        }


def parameters(section: type[Section], prefix: str = "") -> list[Parameter]:
    """Every parameter of a section and of the sections within it; list items as name.0."""
    found: list[Parameter] = []
    for name, info in section.model_fields.items():
        key, kinds = prefix + name, _kinds(info.annotation)
        inner = next((k for k in kinds if isinstance(k, type) and issubclass(k, Section)), None)
        if inner:
            listed = get_origin(info.annotation) is list
            found += parameters(inner, f"{key}.0." if listed else f"{key}.")
            continue
        extra = info.json_schema_extra if isinstance(info.json_schema_extra, dict) else {}
        limits = [
            f"{sign} {getattr(m, a)}" for m in info.metadata for a, sign in _SIGNS if hasattr(m, a)
        ]
        found.append(
            Parameter(
                key=key,
                kind=" | ".join(_kind_name(k) for k in kinds if k is not type(None)),
                default="required" if info.is_required() else _plain(info.default),
                unit=str(extra.get("unit", "-")),
                limits=", ".join(limits),
                text=info.description or "",
            )
        )
    return found


_SIGNS = (("gt", ">"), ("ge", ">="), ("lt", "<"), ("le", "<="))


def _kinds(annotation: Any) -> list[Any]:
    """The types an annotation allows, Annotated, Optional, Literal and list opened up."""
    origin = get_origin(annotation)
    if origin is Annotated:
        return _kinds(get_args(annotation)[0])
    if origin in (Union, UnionType, list):
        return [k for a in get_args(annotation) for k in _kinds(a)]
    return list(get_args(annotation)) if origin is Literal else [annotation]


def _kind_name(kind: Any) -> str:
    if get_origin(kind) is tuple:
        return "[x, y, z]" if len(get_args(kind)) == 3 else "[x, z]"
    return kind.__name__ if isinstance(kind, type) else str(kind)


def _plain(value: Any) -> str:
    return "" if value is None else str(list(value) if isinstance(value, tuple) else value)
