"""Surface of the water and bodies as triangle meshes, with the water's motion at the vertices."""

from typing import Any

import numpy as np

from msph.fluid.boundary.body_faces import faces
from msph.fluid.boundary.rigid_bodies import centre
from msph.fluid.simulation import Simulation
from msph.measure.host_kernels import wendland
from msph.picture.droplets_view import DISSOLVED, FROTH, PATCH
from msph.surface.mesh import SurfaceMesh
from msph.surface.whitewater import Whitewater

# Number of particles per layer averaged at a surface vertex: half a kernel's ball is air.
NEAREST = 40


def surface_arrays(
    mesh: SurfaceMesh, simulation: Simulation, white: Whitewater | None, layer: bool = False
) -> tuple[np.ndarray, np.ndarray, np.ndarray, dict[str, np.ndarray]]:
    """Returns the vertices (v, 3) [m], normals (v, 3) and triangles (t, 3) of the last surface, and
    arrays at its vertices: velocity (v, 3) [m/s], foam (v,), the covered share from 0 to 1, and, if
    asked for, layer (v,)."""
    vertices, normals, triangles = mesh.to_numpy()
    p = simulation.particles
    arrays = {"velocity": p.numpy("v")} | ({"layer": p.numpy("layer")} if layer else {})
    arrays = interpolated(vertices, simulation, arrays)
    arrays["foam"] = foam_at(vertices, white, max(simulation.size))
    return vertices, normals, triangles, arrays


def surface_mesh(
    mesh: SurfaceMesh, simulation: Simulation, white: Whitewater | None, layer: bool = False
) -> Any:
    """Returns surface_arrays() as a trimesh.Trimesh."""
    import trimesh  # slow to import

    vertices, normals, triangles, arrays = surface_arrays(mesh, simulation, white, layer)
    made = trimesh.Trimesh(vertices, triangles, vertex_normals=normals, process=False)
    made.vertex_attributes.update(arrays)
    return made


def body_mesh(simulation: Simulation, body: int) -> Any:
    """Returns a body at its present pose as a trimesh.Trimesh, without its extension into walls."""
    mesh = faces(shown_body(simulation, body))
    turn, at, start = body_pose(simulation, body)
    mesh.vertices = at + (mesh.vertices - start) @ turn.T
    return mesh


def shown_body(simulation: Simulation, body: int) -> Any:
    """Returns a body as the scene gives it: bodies of the boundary are extended into walls."""
    given = simulation.plan.bodies
    return given[body] if body < len(given) else simulation.boundary.bodies[body]


def body_pose(simulation: Simulation, body: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Returns the rotation (3, 3) of a body since time zero, and its centre [m] now and at time
    zero, (3,)."""
    boundary = simulation.boundary
    start = centre(shown_body(simulation, body))
    shift, turn = boundary.pose(body)
    return turn, start + shift, start


def interpolated(
    points: np.ndarray, simulation: Simulation, arrays: dict[str, np.ndarray]
) -> dict[str, np.ndarray]:
    """Returns arrays of the particles at `points` (p, 3) [m]: means weighted by V_j W(r_j, h_j)
    (Shepard 1968), of integers the value of the nearest particle."""
    if not len(points):
        return {name: values[:0] for name, values in arrays.items()}
    # Imported here because it is slow.
    from scipy.spatial import cKDTree

    x, layers = simulation.particles.numpy("x"), simulation.particles.numpy("layer")
    specs = simulation.layers.specs
    # By layer, since a coarse particle that reaches a point is seldom among its nearest.
    found_r, found_near = [], []
    for layer in np.unique(layers):
        own = np.flatnonzero(layers == layer)
        some_r, some = cKDTree(x[own]).query(points, k=min(NEAREST, len(own)))
        found_r.append(some_r.reshape(len(points), -1))
        found_near.append(own[some].reshape(len(points), -1))
    r, near = np.hstack(found_r), np.hstack(found_near)
    order = r.argsort(axis=1)
    r, near = np.take_along_axis(r, order, 1), np.take_along_axis(near, order, 1)
    volume, support = (np.array([getattr(s, k) for s in specs]) for k in ("volume", "support"))
    weight = volume[layers[near]] * wendland(r, support[layers[near]])
    # Outside every kernel the nearest particle gives the value.
    weight[:, 0] += np.where(weight.sum(axis=1) > 0.0, 0.0, 1.0)
    weight /= weight.sum(axis=1, keepdims=True)
    found = {}
    for name, values in arrays.items():
        if values.dtype.kind == "i":
            found[name] = values[near[:, 0]]
        else:
            found[name] = np.einsum("pk,pk...->p...", weight, values[near])
    return found


def foam_at(points: np.ndarray, white: Whitewater | None, longest: float) -> np.ndarray:
    """Returns the share (p,) of the surface at `points` (p, 3) [m] that foam covers: patches of
    foam have the sizes and opacities of images, which add up to 1 - exp(-sum). longest [m]: edge of
    the box."""
    found = np.zeros(len(points), np.float32)
    if white is None or not white.started or not len(points):
        return found
    from scipy.spatial import cKDTree

    table = white.table.struct.to_numpy()
    kept = table["life"] * table["foam"] > 0.0
    x, life, foam = (table[name][kept] for name in ("x", "life", "foam"))
    radius = longest * (DISSOLVED + (PATCH - DISSOLVED) * life)
    tree, patches = cKDTree(points), zip(x, radius, FROTH * life * foam, strict=True)
    for at, reach, opacity in patches:
        near = tree.query_ball_point(at, reach)
        q = ((points[near] - at) ** 2).sum(axis=1) / reach**2
        found[near] += opacity * (1.0 - q) ** 2
    return 1.0 - np.exp(-found)
