"""Meshes and functions that the tests of images share."""

import numpy as np
import taichi as ti
import trimesh

from msph.picture.pixels import colours
from msph.picture.rasteriser import NO_ITEM
from msph.surface import SurfaceMesh
from tests.fluid.fluid_kit import fill, spec_of

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


class Mesh(SurfaceMesh):
    """Surface mesh that tests refill."""

    def __init__(self, capacity=16384):
        super().__init__(capacity, capacity)

    def fill(self, vertices, triangles, normals):
        fill(self.vertices, vertices)
        fill(self.normals, normals)
        fill(self.triangles, triangles, np.int32)
        self.counts.from_numpy(np.array(2 * (len(vertices), len(triangles)), np.int32))


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


def items(raster, width=WIDTH, height=HEIGHT):
    """Returns the numbers of the visible triangles or spheres (width, height), -1 without any."""
    key = raster.key.to_numpy()[:width, :height]
    return np.where(key == NO_ITEM, -1, key & ((1 << raster.item_bits[None]) - 1))


def covered(raster, width=WIDTH, height=HEIGHT):
    return items(raster, width, height) >= 0


def rays(shot, width, height):
    """Returns the rays through all pixels (width, height, 3), with a forward component of 1."""
    i, j = np.meshgrid(np.arange(width), np.arange(height), indexing="ij")
    return shot["origin"] + i[..., None] * shot["du"] + j[..., None] * shot["dv"]


def sphere(p, r, centre, radius):
    """Returns both distances along rays p + t r to a sphere, in lengths of r; NaN for a miss."""
    c, squares = p - centre, (r**2).sum(axis=-1)
    b = (c * r).sum(axis=-1) / squares
    with np.errstate(invalid="ignore"):
        half = np.sqrt(b**2 - ((c**2).sum(axis=-1) - radius**2) / squares)
    return -b - half, -b + half
