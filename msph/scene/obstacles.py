"""Building and checking the bodies of a scene: its obstacles and its container."""

import math

import numpy as np

from msph.fluid.boundary.rigid_bodies import Ball, Block, Body, Motion, Solid, bounding_radius
from msph.fluid.methods import METHODS, methods_with
from msph.scene.errors import SceneError, in_metres
from msph.scene.meshes import MeshError, load_mesh
from msph.scene.schema import Container, Obstacle, Scene

# Largest speed of a body's surface [m/s]; the speed of sound in water is 1480 m/s.
MAX_SPEED = 500.0
# Largest extent of a mesh over the box's longest edge; larger meshes are in another unit.
MAX_EXTENT = 50.0


def bodies(scene: Scene) -> list[Body]:
    """Returns the bodies of a checked scene, the container first."""
    found: list[Body] = [] if scene.container is None else [_container(scene.container)]
    return found + [body(obstacle) for obstacle in scene.obstacles]


def body(obstacle: Obstacle) -> Body:
    """Returns the body of a checked obstacle."""
    motion = Motion(
        velocity=obstacle.velocity,
        swing=obstacle.swing,
        period=obstacle.period,
        axis=obstacle.axis,
        rate=math.radians(obstacle.spin),
    )
    if obstacle.mesh is not None:
        return Solid(*placed(obstacle), motion)
    if obstacle.radius is not None:
        return Ball(np.array(obstacle.centre, float), obstacle.radius, motion)
    return Block(np.array(obstacle.lo, float), np.array(obstacle.hi, float), motion)


def _container(container: Container) -> Solid:
    return Solid(*placed(container), container=True)


def placed(mesh: Obstacle | Container) -> tuple[np.ndarray, np.ndarray]:
    """Returns vertices [m] and triangles of a mesh: scaled, rotated about x, y, z, translated."""
    from scipy.spatial.transform import Rotation  # 0.5 s to import, and only meshes need it

    vertices, triangles = load_mesh(str(mesh.mesh))
    rotation = Rotation.from_euler("xyz", mesh.rotation, degrees=True)
    return rotation.apply(vertices * mesh.scale) + np.array(mesh.position), triangles


def check_bodies(scene: Scene, spacing: float, where: str) -> list[Body]:
    """Returns the bodies of a scene, the container first; spacing: the finest layer's [m].

    Raises SceneError for an obstacle or a container that cannot be built."""
    found: list[Body] = []
    if (scene.obstacles or scene.container) and not METHODS[scene.method].HAS_BODIES:
        key = "obstacles" if scene.obstacles else "container"
        able = methods_with("HAS_BODIES")
        raise SceneError(where, f"the method {scene.method} has no bodies; {able} has", key)
    if scene.container is not None:
        _check_mesh(scene.container, where, "container")
        found.append(_container(scene.container))
        lo, hi = found[0].bounds
        if np.any(lo < 0.0) or np.any(hi > np.array(scene.box.size)):
            raise SceneError(
                where,
                f"reaches from {in_metres(lo)} to {in_metres(hi)}, outside the box of "
                f"{in_metres(scene.box.size)}",
                "container",
            )
    for i, obstacle in enumerate(scene.obstacles):
        found.append(_check_obstacle(scene, obstacle, spacing, where, f"obstacles.{i}"))
    return found


def _check_obstacle(scene: Scene, obstacle: Obstacle, spacing: float, where: str, key: str) -> Body:
    shapes = (
        (obstacle.lo, obstacle.hi),
        (obstacle.centre, obstacle.radius),
        (obstacle.mesh,),
    )
    given = [shape for shape in shapes if any(part is not None for part in shape)]
    if len(given) != 1 or any(part is None for part in given[0]):
        raise SceneError(where, "give either lo and hi, or centre and radius, or mesh", key)
    if obstacle.mesh is not None:
        _check_mesh(obstacle, where, key)
    if not any(obstacle.axis):
        raise SceneError(where, "has no direction", f"{key}.axis")
    made = body(obstacle)
    speed = made.motion.top_speed(bounding_radius(made))
    if speed > MAX_SPEED:
        raise SceneError(
            where,
            f"its surface moves at {speed:.3g} m/s; at most {MAX_SPEED:g} m/s is allowed, beyond "
            "which water is not incompressible",
            key,
        )
    lo, hi = made.bounds
    if np.any(hi <= lo):
        raise SceneError(where, "has no volume: hi must exceed lo on every axis", f"{key}.hi")
    if np.min(hi - lo) < spacing:
        raise SceneError(
            where,
            f"is {np.min(hi - lo):.3g} m thick, less than the particle spacing of {spacing:.3g} m, "
            "so water on both sides would interact through it",
            key,
        )
    times = float(np.max(hi - lo) / max(scene.box.size))
    if obstacle.mesh is not None and times > MAX_EXTENT:
        raise SceneError(
            where,
            f"is {np.max(hi - lo):.3g} m large, {times:.0f} times the box; a mesh in millimetres "
            "needs scale = 0.001",
            f"{key}.mesh",
        )
    outside = np.any(hi <= 0.0) or np.any(lo >= np.array(scene.box.size))
    if outside and not made.motion.moves:
        raise SceneError(where, "is outside the box and does not move", key)
    return made


def _check_mesh(mesh: Obstacle | Container, where: str, key: str) -> None:
    try:
        load_mesh(str(mesh.mesh))
    except MeshError as error:
        raise SceneError(where, str(error), f"{key}.mesh") from None
