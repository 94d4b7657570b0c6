"""Bodies in the picture: rays against spheres by formula, shadows, and who hides whom."""

import numpy as np
import pytest
import taichi as ti
import trimesh
from picture_kit import Mesh, ball, covered, rays

from msph.fluid.boundary.rigid_bodies import Ball, Solid
from msph.fluid.particles.layers import LayerSpec
from msph.picture.body_shading import MISSED, BodyShading
from msph.picture.camera import Camera
from msph.picture.picture import Picture
from tests.boundary_kit import boundary_of

BOX = (1.0, 1.0, 1.0)
LAYER = LayerSpec(1000.0 * 0.04**3, 1000.0, 2.0)
BALL, RADIUS = np.array((0.3, 0.5, 0.5)), 0.15
SHELL, ROOM = np.array((0.5, 0.5, 0.5)), 0.45
WIDTH, HEIGHT = 96, 54


@pytest.fixture
def boundary():
    shell = trimesh.creation.icosphere(3, radius=ROOM)
    shell.apply_translation(SHELL)
    container = Solid(np.array(shell.vertices), np.array(shell.faces), container=True)
    return boundary_of(BOX, [LAYER], [Ball(BALL, RADIUS), container])


@ti.data_oriented
class Rays:
    def __init__(self, boundary, p, r):
        self.bodies = BodyShading(boundary)
        self.bodies.load(BOX)
        n = len(p)
        self.p, self.r = (ti.Vector.field(3, ti.f32, shape=n) for _ in range(2))
        self.p.from_numpy(p.astype(np.float32))
        self.r.from_numpy(r.astype(np.float32))
        self.t, self.lit, self.steep = (ti.field(ti.f32, shape=n) for _ in range(3))
        self.body = ti.field(ti.i32, shape=n)
        self.run()

    @ti.kernel
    def run(self):
        for i in self.p:
            t, body, steep, _ = self.bodies.intersect(self.p[i], self.r[i], 10.0, 0.0, 0.0)
            self.t[i], self.body[i], self.steep[i] = t, body, steep
            self.lit[i] = self.bodies.sunlit(self.p[i], self.r[i])


def sphere(p, r, centre, radius):
    """Both distances along rays p + t r to a sphere; not finite where it is missed."""
    c = p - centre
    b = (c * r).sum(axis=1)
    with np.errstate(invalid="ignore"):
        half = np.sqrt(b**2 - (c**2).sum(axis=1) + radius**2)
    return -b - half, -b + half


def test_rays_meet_bodies_outside_and_the_container_inside(boundary):
    rng = np.random.default_rng(4)
    p = SHELL + 2.0 * unit(rng.normal(size=(400, 3)))
    r = unit(SHELL + 0.5 * rng.uniform(-1.0, 1.0, (400, 3)) - p)
    found = Rays(boundary, p, r)
    near, _ = sphere(p, r, BALL, RADIUS)
    first, far = sphere(p, r, SHELL, ROOM)
    grazing = abs(far - first) < 0.15
    expected = np.where(np.isfinite(near), near, np.where(np.isfinite(far), far, MISSED))
    assert 20 < np.isfinite(near).sum() < 200
    t = np.minimum(found.t.to_numpy(), MISSED)
    sure = ~grazing & ~(abs(near - sphere(p, r, BALL, RADIUS)[1]) < 0.05)
    # The icosphere of the container lies up to 1 % of its radius within the sphere.
    assert np.isclose(t, expected, atol=0.02)[sure].all()
    body = found.body.to_numpy()
    assert np.array_equal(body[sure] == 0, np.isfinite(near)[sure])
    assert np.array_equal(found.steep.to_numpy()[sure] >= 0.0, np.isfinite(far)[sure])
    lit = found.lit.to_numpy()
    aside = np.linalg.norm(np.cross(BALL - p, r), axis=1)
    assert np.all(lit[aside < 0.99 * RADIUS] == 0.0)
    assert np.all(lit[aside > 2.0 * RADIUS] > 0.99)


def unit(v):
    return v / np.linalg.norm(v, axis=1, keepdims=True)


def test_body_hides_water_behind_it_and_water_before_it_shows():
    body = boundary_of(BOX, [LAYER], [Ball(np.array((0.5, 0.5, 0.5)), 0.2)])
    mesh = Mesh(4096)
    picture = Picture(mesh, body)
    picture.load(WIDTH, HEIGHT, BOX)
    view = Camera.framing(BOX, WIDTH / HEIGHT, azimuth=0.0, elevation=0.2)
    mesh.counts.fill(0)
    picture.draw_water(view)
    dry = picture.image.to_numpy()
    d = rays(picture.lens.numbers, WIDTH, HEIGHT).reshape(-1, 3)
    length = np.linalg.norm(d, axis=1)
    eye = np.tile(picture.lens.numbers["eye"], (len(d), 1))
    near, _ = sphere(eye, d / length[:, None], np.array((0.5, 0.5, 0.5)), 0.2)
    inside = np.isfinite(near).reshape(WIDTH, HEIGHT)
    depth = picture.backdrop.depth.to_numpy()[:WIDTH, :HEIGHT]
    assert abs((depth < 100.0).sum() - inside.sum()) < 0.05 * inside.sum()
    # Between samples depth is a mean, here of a ball only 14 pixels wide.
    assert depth[inside & (depth < 100.0)] == pytest.approx(
        (near / length).reshape(WIDTH, HEIGHT)[inside & (depth < 100.0)], abs=0.015
    )
    # A drop behind the ball changes nothing, one before it does.
    for z, shown in ((0.15, False), (0.85, True)):
        mesh.fill(
            *ball(view.eye + (0.5 - view.eye) * (view.eye[2] - z) / (view.eye[2] - 0.5), 0.06)
        )
        picture.draw_water(view)
        drop = covered(picture.raster, WIDTH, HEIGHT)
        assert (drop & inside).sum() > 5
        changed = abs(picture.image.to_numpy() - dry).max(axis=-1) > 1e-3
        assert changed[drop & inside].mean() > 0.5 if shown else not changed[inside].any()
