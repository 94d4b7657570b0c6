"""Building and checking the bodies of a scene, its container included."""

import math
from collections import Counter
from dataclasses import replace

import numpy as np

from msph.fluid.boundary.rigid_bodies import (
    AnyMotion,
    Body,
    Motion,
    Scripted,
    Solid,
    bounding_radius,
    rotations,
    volume,
)
from msph.fluid.external_forces import as_vector
from msph.fluid.methods import METHODS, methods_with
from msph.fluid.room import MAX_BODIES
from msph.parameter import MAX_SPEED
from msph.picture.tone import albedo
from msph.scene import schema
from msph.scene.errors import SceneError, explaining, is_one_of, require, require_inside
from msph.scene.meshes import load_mesh
from msph.scene.motion import TOO_FAST, TRIALS, check_formulas, formula_numbers
from msph.scene.openings import walls
from msph.scene.schema import Container, Scene
from msph.scene.water import shape_of
from msph.scene.wavemakers import check_wave_makers, wave_makers

# Largest extent of a mesh over the box's longest edge; larger meshes are in another unit.
MAX_EXTENT = 50.0
# Keys of a body without effect unless one of others is given.
NEEDS = {
    **dict.fromkeys(("rotation", "position", "scale"), ("mesh",)),
    "release": ("density", "mass"),
    "period": ("swing",),
    "axis": ("spin", "angle"),
}


def bodies(scene: Scene) -> list[Body]:
    """Returns the bodies of a checked scene: the container, bodies, wave makers."""
    found: list[Body] = [] if scene.container is None else [_container(scene.container)]
    found += [body(b, scene.duration, f"bodies.{k}") for k, b in enumerate(scene.bodies)]
    return [*found, *wave_makers(scene)]


def keys(scene: Scene) -> list[str]:
    """Returns the keys of the bodies in the scene's file in the order of bodies()."""
    outer = ["container"] if scene.container else []
    own = [f"bodies.{k}" for k in range(len(scene.bodies))]
    return outer + own + [f"wavemakers.{k}" for k in range(len(scene.wavemakers))]


def names(scene: Scene) -> list[str]:
    """Returns the names of the bodies in the order of bodies(), their keys where they have none."""
    given = {f"bodies.{k}": b.name for k, b in enumerate(scene.bodies)}
    return [given.get(key) or key for key in keys(scene)]


def number_of(scene: Scene, body: str) -> int:
    """Returns the index of a body, given by its name or key. Raises SceneError."""
    for known in (names(scene), keys(scene)):
        if body in known:
            return known.index(body)
    listed = ", ".join(names(scene)) or "none"
    raise SceneError("", f"the scene has no body {body}; known: {listed}")


def body(given: schema.BodyEntry, duration: float, key: str) -> Body:
    """Returns the body of a checked table of a scene; duration [s]: of the scene; key: of the
    table."""
    motion: AnyMotion = Motion(
        velocity=given.velocity,
        swing=given.swing,
        period=given.period,
        axis=given.axis,
        rate=math.radians(given.spin),
    )
    if _follows_formulas(given):
        motion = _scripted(given, duration, key)
    made: Body
    if given.mesh is not None:
        paint = load_mesh(given.mesh)[2] if given.colour is None else None
        made = Solid(*placed(given), motion, paint=paint)
    else:
        made = replace(shape_of(given), motion=motion)
    mass = given.mass if given.density is None else given.density * volume(made)
    one = None if given.colour is None else as_vector(albedo(given.colour))
    return replace(made, mass=mass, friction=given.friction, release=given.release, albedo=one)


def _follows_formulas(given: schema.BodyEntry) -> bool:
    """Returns True for a body whose pose is given by expressions."""
    return any((*given.displacement, given.angle))


def _scripted(given: schema.BodyEntry, duration: float, key: str) -> Scripted:
    """Returns the motion by the expressions of a body; its largest speed within the duration [s] is
    found by finite differences."""
    found = formula_numbers(given, duration, key)
    times = np.linspace(0.0, duration, TRIALS)
    rates = np.abs(np.diff([found(t) for t in times.tolist()], axis=0)) / times[1]
    return Scripted(
        place=lambda time: (found(time)[:3], math.radians(found(time)[3])),
        axis=given.axis,
        pivot=np.zeros(3),
        speed=float(np.linalg.norm(rates[:, :3], axis=1).max()),
        rate=math.radians(rates[:, 3].max()),
        slides=np.array([d != 0.0 for d in given.displacement]),
        spins=given.angle != 0.0,
    )


def _container(container: Container) -> Solid:
    return Solid(*placed(container), container=True)


def placed(mesh: schema.BodyEntry | Container) -> tuple[np.ndarray, np.ndarray]:
    """Returns vertices [m] and triangles of a mesh: scaled, rotated about x, y, z, translated."""
    vertices, triangles, _ = load_mesh(str(mesh.mesh))
    x, y, z = rotations(np.radians(np.diag(mesh.rotation)))
    return vertices * mesh.scale @ (z @ y @ x).T + np.array(mesh.position), triangles


def check_bodies(scene: Scene, spacing: float) -> list[Body]:
    """Returns the bodies() of a scene; spacing [m]: of the finest layer.

    Raises SceneError for a body or a container that cannot be built."""
    found: list[Body] = []
    able = METHODS[scene.method].HAS_BODIES or not (scene.bodies or scene.container)
    problem = f"the method {scene.method} has no bodies; {methods_with('HAS_BODIES')} has"
    require(able, "bodies" if scene.bodies else "container", problem)
    if scene.container is not None:
        _check_mesh(scene.container.mesh, "container")
        found.append(_container(scene.container))
        require_inside(*found[0].bounds, scene.box.size, "container")
    for i, given in enumerate(scene.bodies):
        found.append(_check_body(scene, given, spacing, f"bodies.{i}"))
    for name, others in Counter(names(scene)).items():
        require(others == 1, "bodies", f"there are {others} bodies named {name!r}")
    check_wave_makers(scene)
    found += wave_makers(scene)
    problem = f"make {len(found)} bodies with `bodies` and `container`; at most {MAX_BODIES}"
    require(len(found) <= MAX_BODIES, "wavemakers", problem)
    return found


def _check_body(scene: Scene, given: schema.BodyEntry, spacing: float, key: str) -> Body:
    single = is_one_of((given.lo, given.hi), (given.centre, given.radius), (given.mesh,))
    require(single, key, "give either lo and hi, or centre and radius, or mesh")
    if given.mesh is not None:
        _check_mesh(given.mesh, key)
    require(any(given.axis), f"{key}.axis", "has no direction")
    plain = schema.BodyEntry()
    for name, others in NEEDS.items():
        idle = all(getattr(given, other) == getattr(plain, other) for other in others)
        problem = f"has no effect without {' or '.join(others)}"
        require(not idle or getattr(given, name) == getattr(plain, name), f"{key}.{name}", problem)
    floats = given.density is not None or given.mass is not None
    require(given.density is None or given.mass is None, key, "give either density or mass")
    swings = any(given.swing)
    problem = "a body with a mass floats and cannot swing"
    require(not (floats and swings), f"{key}.swing", problem)
    if _follows_formulas(given):
        moves = any((*given.velocity, *given.swing, given.spin))
        other = "density or mass" if floats else "velocity, swing or spin"
        problem = f"give either {other}, or displacement and angle"
        require(not (floats or moves), key, problem)
        check_formulas(given, scene.duration, key)
    made = body(given, scene.duration, key)
    speed = made.motion.top_speed(bounding_radius(made))
    problem = f"its surface moves at {speed:.3g} m/s; {TOO_FAST}, beyond which water is not "
    require(speed <= MAX_SPEED, key, problem + "incompressible")
    lo, hi = made.bounds
    thinnest, largest = float(np.min(hi - lo)), float(np.max(hi - lo))
    require(thinnest > 0.0, f"{key}.hi", "has no volume: hi must exceed lo on every axis")
    require(
        thinnest >= spacing,
        key,
        f"is {thinnest:.3g} m thick, less than the particle spacing of {spacing:.3g} m, "
        "so water on both sides would interact through it",
    )
    times = largest / max(scene.box.size)
    require(
        given.mesh is None or times <= MAX_EXTENT,
        f"{key}.mesh",
        f"is {largest:.3g} m large, {times:.0f} times the box; a mesh in millimetres "
        "needs scale = 0.001",
    )
    starts_inside = np.all((lo >= 0.0) & (hi <= walls(scene)))
    require(not floats or starts_inside, key, "floats, and must start inside the box")
    outside = np.any(hi <= 0.0) or np.any(lo >= np.array(scene.box.size))
    problem = "is outside the box and does not move"
    require(not outside or made.motion.moves, key, problem)
    return made


def _check_mesh(name: str, key: str) -> None:
    with explaining(f"{key}.mesh"):
        load_mesh(name)
