"""Makes the shipped meshes beside this file: python assets/bodies/make.py

Unit: one metre. Bowl and torus are curves turned about the y axis, the duck blends ellipsoids, the
ramp is a beach; all are closed, their faces outwards. duck.mtl holds the duck's colours.
"""

from pathlib import Path

import numpy as np
import trimesh


def turned(radius, height, sections=64):
    """The curve (radius, height) turned about y; it starts and ends on the axis, or is closed."""
    n, closed = len(radius), radius[0] > 0.0
    angle = 2.0 * np.pi * np.arange(sections) / sections
    ring = np.stack([np.cos(angle), np.zeros(sections), np.sin(angle)], axis=1)
    vertices = radius[:, None, None] * ring + height[:, None, None] * np.array((0.0, 1.0, 0.0))
    index = np.arange(n * sections).reshape(n, sections)
    if closed:
        index = np.vstack([index, index[:1]])
    a, b = index[:-1], index[1:]
    c, d = np.roll(b, -1, axis=1), np.roll(a, -1, axis=1)
    quads = np.stack([a, b, c, d], axis=-1).reshape(-1, 4)
    mesh = trimesh.Trimesh(vertices.reshape(-1, 3), quads[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3))
    mesh.update_faces(mesh.nondegenerate_faces())
    mesh.remove_unreferenced_vertices()
    if mesh.volume < 0.0:
        mesh.invert()
    assert mesh.is_watertight
    return mesh


def bowl(radius=0.5, depth=0.4):
    """Room of a bowl: a cap of a ball, `radius` at the rim, closed by a flat lid at y = depth."""
    ball = (radius**2 + depth**2) / (2.0 * depth)
    angle = np.linspace(0.0, np.arcsin(radius / ball), 33)
    r, y = ball * np.sin(angle), ball * (1.0 - np.cos(angle))
    lid = np.linspace(radius, 0.0, 9)[1:]
    r, y = np.concatenate([r, lid]), np.concatenate([y, np.full(8, depth)])
    r[0] = r[-1] = 0.0
    return turned(r, y, sections=128)


def torus(radius=0.35, tube=0.15):
    angle = 2.0 * np.pi * np.arange(32) / 32
    return turned(radius + tube * np.cos(angle), tube * np.sin(angle))


# The duck's ellipsoids: centre and half axes, for a duck 1 m long that looks along +x. With a hull
# less wide it would capsize: its density is uniform.
DUCK = {
    "hull": ((0.0, -0.08, 0.0), (0.44, 0.19, 0.36)),
    "breast": ((0.14, 0.0, 0.0), (0.24, 0.18, 0.26)),
    "head": ((0.2, 0.25, 0.0), (0.16, 0.15, 0.15)),
    "beak": ((0.38, 0.21, 0.0), (0.12, 0.035, 0.08)),
    "tail": ((-0.42, 0.04, 0.0), (0.14, 0.08, 0.12)),
}
# Colours, linear RGB, of the materials of the duck; eyes: directions from the head's centre and
# radius; front of the head, where the beak begins.
PAINTS = {"plumage": (0.93, 0.60, 0.02), "bill": (0.85, 0.18, 0.01), "eye": (0.012, 0.01, 0.01)}
EYES, EYE_RADIUS = np.array([(0.6, 0.36, 0.71), (0.6, 0.36, -0.71)]), 0.027
BEAK = np.array((0.365, 0.12, 0.0))
# Point from which the whole surface is seen, and width of the blends between ellipsoids.
DUCK_EYE, BLEND = np.array((0.14, 0.06, 0.0)), 0.12


def duck():
    """The surface of the smooth union of ellipsoids, found along rays from DUCK_EYE."""
    mesh = trimesh.creation.icosphere(4)
    # The first crossing from inside: the nearest of samples that is outside, then bisection.
    steps = np.linspace(0.02, 0.8, 200)
    outside = np.array([_beyond(DUCK_EYE + r * mesh.vertices) > 0.0 for r in steps])
    hi = steps[outside.argmax(axis=0)]
    lo = hi - (steps[1] - steps[0])
    for _ in range(30):
        middle = 0.5 * (lo + hi)
        out = _beyond(DUCK_EYE + middle[:, None] * mesh.vertices) > 0.0
        lo, hi = np.where(out, lo, middle), np.where(out, middle, hi)
    mesh = trimesh.Trimesh(DUCK_EYE + hi[:, None] * mesh.vertices, mesh.faces)
    # Planes cut the beak off the head, and a disc for each eye.
    centre, axes = np.array(DUCK["head"])
    ways = EYES / np.linalg.norm(EYES, axis=1)[:, None]
    discs = centre + (axes - EYE_RADIUS**2 / (2.0 * axes)) * ways
    for origin, normal in [(BEAK, (1.0, 0.0, 0.0)), *zip(discs, ways, strict=True)]:
        mesh = divided(mesh, origin, np.array(normal))
    middles = mesh.triangles_center
    paint = (middles[:, :2] > BEAK[:2]).all(axis=1).astype(int)
    for origin, way in zip(discs, ways, strict=True):
        near = np.linalg.norm(middles - origin, axis=1) < 2.0 * EYE_RADIUS
        paint[near & ((middles - origin) @ way > 0.0)] = 2
    assert mesh.is_watertight and mesh.volume > 0.0
    return mesh, paint


def divided(mesh, origin, normal):
    """The mesh with its triangles divided along a plane."""
    cut = trimesh.intersections.slice_faces_plane
    sides = [cut(mesh.vertices, mesh.faces, side * normal, origin)[:2] for side in (1.0, -1.0)]
    mesh = trimesh.util.concatenate([trimesh.Trimesh(*side, process=False) for side in sides])
    mesh.merge_vertices(digits_vertex=7)
    mesh.update_faces(mesh.nondegenerate_faces())
    return mesh


def _beyond(x):
    """About the distance from the smooth union of the ellipsoids, negative inside."""
    parts = []
    for centre, axes in DUCK.values():
        q = np.linalg.norm((x - centre) / axes, axis=1)
        parts.append(q * (q - 1.0) / np.linalg.norm((x - centre) / np.square(axes), axis=1))
    return -BLEND / 3.0 * np.log(sum(np.exp(-3.0 * d / BLEND) for d in parts))


def ramp(slope=0.4, below=0.1, width=0.46):
    """A beach: a block 1 m long whose top rises by `slope` along x, from the floor y = 0; it
    reaches `below` the floor."""
    mesh = trimesh.creation.box(bounds=[[0.0, -below, -0.5 * width], [1.0, 0.0, 0.5 * width]])
    mesh.vertices[:, 1] += slope * mesh.vertices[:, 0] * (mesh.vertices[:, 1] == 0.0)
    return mesh


def write(name, mesh, paint=None):
    """Writes an .obj file beside this one, and an .mtl file if the triangles have a paint, an
    index of PAINTS."""
    file, head = Path(__file__).with_name(f"{name}.obj"), f"made by make.py: {name}"
    text = mesh.export(file_type="obj", digits=6, header=head)
    if paint is not None:
        lines = text.splitlines()
        vertices = [line for line in lines if not line.startswith("f ")]
        faces = np.array([line for line in lines if line.startswith("f ")])
        parts = [f"usemtl {k}\n" + "\n".join(faces[paint == i]) for i, k in enumerate(PAINTS)]
        text = "\n".join([vertices[0], f"mtllib {name}.mtl", *vertices[1:], *parts, ""])
        colours = ["newmtl {}\nKd {:g} {:g} {:g}\n".format(k, *c) for k, c in PAINTS.items()]
        file.with_suffix(".mtl").write_text("\n".join(colours))
    file.write_text(text)


if __name__ == "__main__":
    for shape in (bowl, torus, ramp):
        write(shape.__name__, shape())
    write("duck", *duck())
