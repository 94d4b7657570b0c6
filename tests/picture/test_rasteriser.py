import numpy as np
import pytest
import taichi as ti
from picture_kit import BOX, Mesh, ball, covered, grid, items, rays, sphere

from msph.picture.camera import Camera
from msph.picture.look import Look
from msph.picture.rasteriser import FAR, KEY_BITS, NO_ITEM, Rasteriser
from msph.picture.room import PictureRoom, PixelFields
from msph.picture.shot import Lens, shot_numbers

WIDTH, HEIGHT = 97, 61


@ti.data_oriented
class Bench:
    """Rasteriser with a mesh and three spheres to draw."""

    def __init__(self):
        self.lens, self.mesh = Lens(), Mesh(2048)
        self.raster = Rasteriser(PixelFields(PictureRoom(WIDTH, HEIGHT)), self.lens)
        self.x, self.radius = ti.Vector.field(3, ti.f32, 3), ti.field(ti.f32, 3)

    @ti.kernel
    def draw_mesh(self):
        self.raster.clear(2048)
        self.raster.draw_mesh(self.mesh, 0)

    @ti.kernel
    def draw_spheres(self, n: ti.i32):
        self.raster.clear(n)
        self.raster.draw_spheres(n, self.x, self.radius)

    def aim(self, camera):
        self.lens.set(shot_numbers(camera, None, BOX, WIDTH, HEIGHT, Look()), whole=True)
        return self.lens.numbers, rays(self.lens.numbers, WIDTH, HEIGHT)

    def draw(self, mesh, camera):
        """Draws vertices, triangles and normals; returns the shot and its rays."""
        self.mesh.fill(*mesh)
        aimed = self.aim(camera)
        self.draw_mesh()
        return aimed

    def depth(self):
        """Returns the depth by the keys and the bound of its rounding [m]; FAR where nothing is
        drawn."""
        shot, key = self.lens.numbers, self.raster.key.to_numpy()
        bits = self.raster.item_bits[None]
        step = shot["w_span"] / ((1 << (KEY_BITS - bits)) - 2)
        w = shot["w_near"] - ((key >> bits) + 0.5) * step
        z = np.where(key == NO_ITEM, FAR, 1 / np.maximum(w, 1e-9))
        return z, step * z**2

    def back(self):
        return self.raster.back.to_numpy().view(np.float32)


@pytest.fixture(scope="module")
def bench(taichi_runtime):
    return Bench()


def test_depth_of_a_plane_is_exact(bench):
    plane = grid((0.1, 0.3, 0.9), (0.8, 0.1, 0), (0, 0.1, -0.7), 9)
    shot, d = bench.draw(plane, Camera.framing(BOX))
    n = np.cross((0.8, 0.1, 0), (0, 0.1, -0.7))
    want = (np.array((0.1, 0.3, 0.9)) - shot["eye"]) @ n / (d @ n)
    seen, (z, slack) = covered(bench.raster, WIDTH, HEIGHT), bench.depth()
    assert seen.sum() > 250
    assert (np.abs(z - want) < 1.01 * slack + 1e-5)[seen].all()
    assert slack[seen].max() < 2e-4


def test_back_side_of_a_plane_is_not_a_front(bench):
    v, t, n = grid((0.1, 0.3, 0.9), (0.8, 0.1, 0), (0, 0.1, -0.7), 3)
    bench.draw((v, t[:, ::-1], n), Camera.framing(BOX))
    assert not covered(bench.raster, WIDTH, HEIGHT).any()
    assert (bench.back() < FAR).sum() > 250


def test_faces_on_the_walls_do_not_count_as_back(bench):
    wall = grid((0, 0.3, 0.9), (0, 0.3, 0), (0, 0, -0.7), 3)
    bench.draw(wall, Camera.framing(BOX, azimuth=4.9))
    assert not (bench.back() < FAR).any()


def test_no_cracks_between_triangles(bench):
    """The surface is wider than the image and has triangles in all orientations."""
    v, t, n = grid((-3, 0, 3), (7, 0, 0), (0, 0, -7), 30)
    v[:, [0, 2]] += 0.03 * np.sin(37 * v[:, [2, 0]])
    for azimuth in (0.0, 0.4, 1.3):
        bench.draw((v, t, n), Camera(np.array((0.5, 0, 0.5)), azimuth, 1.2, 1.5, 0.7))
        assert covered(bench.raster, WIDTH, HEIGHT).all()


def test_triangles_through_the_near_plane_stay_on_their_plane(bench):
    """Two huge triangles lie below and behind the eye."""
    plane = grid((-40, 0, 40), (80, 0, 0), (0, 0, -80), 1)
    shot, d = bench.draw(plane, Camera(np.array((0.5, 0.4, 0.5)), 0.3, 0.2, 1.6, 1.2))
    with np.errstate(divide="ignore"):
        z = -shot["eye"][1] / d[..., 1]
    hit = shot["eye"] + d * z[..., None]
    inside = (d[..., 1] < 0) & (np.abs(hit[..., [0, 2]]) < 39).all(-1) & (z * shot["w_near"] > 1)
    outside = (d[..., 1] >= 0) | (np.abs(hit[..., [0, 2]]) > 41).any(-1)
    seen = covered(bench.raster, WIDTH, HEIGHT)
    assert inside.sum() > 500 and outside.sum() > 500
    assert seen[inside].all() and not seen[outside].any()


def test_thickness_of_a_ball(bench):
    centre, r = np.array((0.5, 0.4, 0.5)), 0.2
    shot, d = bench.draw(ball(centre, r), Camera.framing(BOX))
    near, far = sphere(shot["eye"], d, centre, r)
    chord = far - near
    deep = chord * np.linalg.norm(d, axis=-1) > r  # away from the rim, where facets matter
    got = (bench.back() - bench.depth()[0])[deep]
    assert deep.sum() > 100
    np.testing.assert_allclose(got, chord[deep], atol=0.03 * r)


def test_spheres_are_round_and_the_nearest_is_visible(bench):
    camera = Camera.framing(BOX)
    shot, d = bench.aim(camera)
    middle = np.array((0.5, 0.4, 0.5))
    toward = (shot["eye"] - middle) / np.linalg.norm(shot["eye"] - middle)
    centres = np.array([middle, middle + 0.3 * toward, (0.9, 0.1, 0.2)])
    radii = np.array((0.2, 0.08, 0.1))
    bench.x.from_numpy(centres.astype(np.float32))
    bench.radius.from_numpy(radii.astype(np.float32))
    bench.draw_spheres(3)
    best, owner = np.full(d.shape[:2], FAR), np.full(d.shape[:2], -1)
    for k, (c, r) in enumerate(zip(centres, radii, strict=True)):
        z, _ = sphere(shot["eye"], d, c, r)
        z = np.where(np.isnan(z), FAR, z)
        owner[z < best] = k
        best = np.minimum(best, z)
    got = items(bench.raster, WIDTH, HEIGHT)
    assert (got != owner).mean() < 2e-3
    z, slack = bench.depth()
    same = (got == owner) & (owner >= 0)
    assert (np.abs(z - best) < 1.01 * slack + 1e-4)[same].all()
    assert (got == 1).sum() > 10, "the small sphere in front must be seen"
