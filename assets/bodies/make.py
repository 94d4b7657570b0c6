"""Makes the shipped meshes beside this file: python assets/bodies/make.py

Unit: one metre. Each is a curve turned about the y axis, closed, its faces outwards.
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
    angle = np.linspace(0.0, np.arcsin(radius / ball), 25)
    r, y = ball * np.sin(angle), ball * (1.0 - np.cos(angle))
    lid = np.linspace(radius, 0.0, 9)[1:]
    r, y = np.concatenate([r, lid]), np.concatenate([y, np.full(8, depth)])
    r[0] = r[-1] = 0.0
    return turned(r, y)


def torus(radius=0.35, tube=0.15):
    angle = 2.0 * np.pi * np.arange(32) / 32
    return turned(radius + tube * np.cos(angle), tube * np.sin(angle))


if __name__ == "__main__":
    for shape in (bowl, torus):
        text = shape().export(
            file_type="obj", digits=6, header=f"made by make.py: {shape.__name__}"
        )
        Path(__file__).with_name(f"{shape.__name__}.obj").write_text(text)
