"""Meshes and functions that the tests of images share."""

import numpy as np
import taichi as ti
import trimesh

from msph.picture.pixels import colours
from msph.picture.rasteriser import NO_ITEM
from tests.fluid.fluid_kit import spec_of

BOX = (1.0, 0.8, 1.0)
LAYER = spec_of(0.04, 2.0)
LEVEL = 0.4
WIDTH, HEIGHT = 320, 180


def canvas_of(picture) -> np.ndarray:
    """Returns the colours (WIDTH, HEIGHT, 3) of the rays, before edges are smoothed."""
    return colours(picture.fields.canvas.to_numpy()[:WIDTH, :HEIGHT])


def draw(picture, view, water=None, tilt=None) -> None:
    """Draws a mesh of water, or a box without water."""
    if water:
        picture.mesh.fill(*water)
    else:
        picture.mesh.counts.fill(0)
    picture.draw_water(view, tilt)


def backdrop_of(picture) -> np.ndarray:
    """Returns colours and opacity of edge lines (WIDTH, HEIGHT, 4) of the image without water."""
    shown, lines = picture.backdrop.colour.to_numpy(), picture.backdrop.lines.to_numpy()
    return np.concatenate([colours(shown), lines[..., None]], axis=2)[:WIDTH, :HEIGHT]


class Mesh:
    """Surface mesh of fixed capacity that tests refill."""

    def __init__(self, capacity=16384):
        self.vertices = ti.Vector.field(3, ti.f32, capacity)
        self.normals = ti.Vector.field(3, ti.f32, capacity)
        self.triangles = ti.Vector.field(3, ti.i32, capacity)
        self.counts = ti.field(ti.i32, 2)

    def fill(self, vertices, triangles, normals=None):
        vertices, triangles = np.asarray(vertices, float), np.asarray(triangles)
        normals = np.tile((0.0, 1.0, 0.0), (len(vertices), 1)) if normals is None else normals
        for field, values in (
            (self.vertices, vertices),
            (self.normals, normals),
            (self.triangles, triangles),
        ):
            kind = np.int32 if field is self.triangles else np.float32
            padded = np.zeros((field.shape[0], 3), kind)
            padded[: len(values)] = values
            field.from_numpy(padded)
        self.counts.from_numpy(np.array((len(vertices), len(triangles)), np.int32))


class NoDrops:
    """Replacement of ThinWater without spray, whose relief is flat and full of bubbles."""

    class Particles:
        x = v = None

    class Spray:
        loose = count = None

    @ti.data_oriented
    class Relief:
        @ti.func
        def at(self, x):
            return ti.math.vec4(0.0, 0.0, 0.0, 2.0)

    def __init__(self):
        self.spray, self.relief = self.Spray(), self.Relief()
        self.spray.count, self.spray.loose = ti.field(ti.i32, ()), ti.field(ti.i32, 1)
        self.particles = self.Particles()
        self.particles.x = self.particles.v = ti.Vector.field(3, ti.f32, 1)

    @ti.func
    def spacing(self, p):
        return 0.02


def grid(corner, a, b, n):
    """Returns vertices, triangles and normals of n x n squares in the parallelogram at `corner`
    that a and b span; its front faces a x b."""
    corner, a, b = (np.asarray(v, float) for v in (corner, a, b))
    u, v = np.meshgrid(np.linspace(0, 1, n + 1), np.linspace(0, 1, n + 1), indexing="ij")
    points = corner + u.reshape(-1, 1) * a + v.reshape(-1, 1) * b
    k = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
    p, q, r, s = (m.ravel() for m in (k[:-1, :-1], k[1:, :-1], k[1:, 1:], k[:-1, 1:]))
    triangles = np.concatenate([np.stack([p, q, r], 1), np.stack([p, r, s], 1)])
    normal = np.cross(a, b)
    return points, triangles, np.tile(normal / np.linalg.norm(normal), (len(points), 1))


def join(parts):
    vertices, triangles, normals, at = [], [], [], 0
    for v, t, n in parts:
        vertices.append(v)
        triangles.append(t + at)
        normals.append(n)
        at += len(v)
    return tuple(map(np.concatenate, (vertices, triangles, normals)))


def still_water(level=LEVEL, n=8):
    """Returns the closed surface of still water in the box."""
    x, _, z = BOX
    o, ex, ey, ez = np.zeros(3), np.array((x, 0, 0)), np.array((0, level, 0)), np.array((0, 0, z))
    return join(
        [
            grid(ey, ez, ex, n),  # top
            grid(o, ex, ez, n),
            grid(o, ey, ex, n),
            grid(ez, ex, ey, n),
            grid(o, ez, ey, n),
            grid(ex, ey, ez, n),
        ]
    )


def ball(centre, radius):
    """Returns vertices, triangles and normals of a closed sphere."""
    sphere = trimesh.creation.icosphere(3, radius)
    return sphere.vertices + centre, sphere.faces, sphere.vertices / radius


def covered(raster, width=WIDTH, height=HEIGHT):
    return raster.key.to_numpy()[:width, :height] != NO_ITEM


def rays(shot, width, height):
    """Returns the rays through all pixels (width, height, 3), with a forward component of 1."""
    i, j = np.meshgrid(np.arange(width), np.arange(height), indexing="ij")
    return shot["origin"] + i[..., None] * shot["du"] + j[..., None] * shot["dv"]
