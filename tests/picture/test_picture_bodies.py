"""Tests of rendered bodies: rays against spheres by formula, shadows, and visibility."""

import numpy as np
import pytest
import taichi as ti
import trimesh
from picture_kit import LAYER, ball, covered, draw, items, rays, sphere, still_water

from msph.fluid.boundary.body_faces import triangles_of
from msph.fluid.boundary.rigid_bodies import Ball, Block, Motion
from msph.picture.body_faces import KEY_BITS
from msph.picture.body_paint import lattice
from msph.picture.body_shading import BodyShading
from msph.picture.camera import Camera
from msph.picture.look import Look
from msph.picture.pixels import colours
from msph.picture.rasteriser import FAR, NO_ITEM
from msph.picture.room import COARSE
from msph.picture.shadows import SHARPNESS, SUN
from msph.picture.tone import CLAY, linear
from tests.boundary_kit import boundary_of, solid

BOX = (1.0, 1.0, 1.0)
BALL, RADIUS = np.array((0.3, 0.5, 0.5)), 0.15
TUB, TUB_LID = 0.4, 0.25  # radius [m], height of the lid above the middle [m]
SHELL, ROOM = np.array((0.5, 0.5, 0.5)), 0.45
PLINTH = (0.7, 0.0, 0.3), (0.9, 0.5, 0.7)
WIDTH, HEIGHT = 96, 54
VECTORS, NUMBERS = ti.types.ndarray(ti.math.vec3, 1), ti.types.ndarray(ti.f32, 2)


@pytest.fixture
def boundary():
    container = solid(trimesh.creation.icosphere(3, radius=ROOM), SHELL, container=True)
    return boundary_of(BOX, [LAYER], [Ball(BALL, RADIUS), container])


@ti.data_oriented
class Rays:
    """Rays through the bodies of the boundary, compiled once for all tests."""

    def __init__(self):
        self.bodies = BodyShading(boundary_of(BOX, [LAYER]))

    def trace(self, p, r):
        """Traces rays p + t r, (n, 3). Returns t and body, (n,) each."""
        self.bodies.load(BOX)
        found = np.zeros((len(p), 2), np.float32)
        self._trace(p.astype(np.float32), r.astype(np.float32), found)
        return found.T

    @ti.kernel
    def _trace(self, p: VECTORS, r: VECTORS, found: NUMBERS):
        for i in range(p.shape[0]):
            t, body, _, _ = self.bodies.intersect(p[i], r[i], 10.0, 0.0, 0.0)
            found[i, 0], found[i, 1] = t, body


@ti.data_oriented
class Lit:
    """Light that bodies leave, by the shadow maps of a picture."""

    def __init__(self, picture):
        self.shadows = picture.backdrop.shadows

    def at(self, p):
        """Returns the share of the sun at points (n, 3), (n,)."""
        found = np.zeros((len(p), 1), np.float32)
        self._read(p.astype(np.float32), found)
        return found[:, 0]

    @ti.kernel
    def _read(self, p: VECTORS, found: NUMBERS):
        for i in range(p.shape[0]):
            found[i, 0] = self.shadows.share(p[i], SUN)


@pytest.fixture(scope="module")
def rays_of(taichi_runtime):
    return Rays()


@pytest.fixture(scope="module")
def lit(built):
    return Lit(built)


def framing(*angles):
    return Camera.framing(BOX, WIDTH / HEIGHT, *angles)


def draw_bodies(picture, bodies, view=None, water=None):
    """Draws bodies and a mesh of water, if given."""
    boundary_of(BOX, [LAYER], bodies)
    picture.load(WIDTH, HEIGHT, BOX)
    draw(picture, view or framing(), water)


def body_depth(picture):
    """Returns the depths [m] of the visible bodies (WIDTH, HEIGHT), FAR without a body."""
    shot, key = picture.lens.numbers, picture.faces.key.to_numpy()[:WIDTH, :HEIGHT]
    step = shot["w_span"] / ((1 << (31 - KEY_BITS)) - 2)
    w = shot["w_near"] - ((key >> KEY_BITS) + 0.5) * step
    return np.where(key == NO_ITEM, FAR, 1.0 / np.maximum(w, 1e-9))


def test_rays_in_a_container_hit_bodies_and_its_side(boundary, rays_of):
    rng = np.random.default_rng(4)
    p = SHELL + 0.9 * ROOM * rng.uniform(-1.0, 1.0, (2000, 3))
    clear = np.linalg.norm(p - BALL, axis=1) > 1.05 * RADIUS
    p = p[clear & (np.linalg.norm(p - SHELL, axis=1) < 0.95 * ROOM)]
    r = unit(rng.normal(size=p.shape))
    t, body = rays_of.trace(p, r)
    first, last = sphere(p, r, BALL, RADIUS)
    _, far = sphere(p, r, SHELL, ROOM)
    ball = np.isfinite(first) & (first > 0.0)
    assert 50 < ball.sum() < len(p) - 500
    sure = ~ball | (last - first > 0.05)
    # The icosphere of the container lies inside the sphere, by up to 1 % of its radius.
    assert np.isclose(t, np.where(ball, first, far), atol=0.02)[sure].mean() > 0.99
    assert np.array_equal(body[sure] == 0, ball[sure])


def slabs(p, r, lo, hi):
    """Returns both distances along rays p + t r to a box, the first larger where a ray misses."""
    a, b = (lo - p) / r, (hi - p) / r
    return np.minimum(a, b).max(axis=1), np.maximum(a, b).min(axis=1)


def test_rays_meet_a_block_and_a_mesh_as_a_formula_says(rays_of):
    lo, hi = np.array((0.3, 0.1, 0.2)), np.array((0.7, 0.5, 0.6))
    mesh = solid(trimesh.creation.box(bounds=(lo, hi)))
    rng = np.random.default_rng(6)
    p = 0.5 * (lo + hi) + unit(rng.normal(size=(600, 3)))
    r = unit(rng.uniform(lo - 0.1, hi + 0.1, (600, 3)) - p)
    first, last = slabs(p, r, lo, hi)
    sure = abs(last - first) > 0.03
    hit = first < last
    assert 100 < hit.sum() < 500
    for body, most in ((Block(lo, hi), 1e-5), (mesh, 3e-3)):
        boundary_of(BOX, [LAYER], [body])
        t, which = rays_of.trace(p, r)
        assert np.array_equal(which[sure] == 0, hit[sure])
        # The other 5 % are grazing rays, which may end HIT_DISTANCE before the side.
        assert np.percentile(abs(t - first)[sure & hit], 95) < most


def test_a_ray_along_the_lid_of_a_container_reaches_its_side(rays_of):
    """Regression: the ray ended after too many short steps, up to 0.37 m before the side."""
    tub = trimesh.creation.cylinder(TUB, 2.0 * TUB_LID, sections=96)
    tub.apply_transform(trimesh.transformations.rotation_matrix(0.5 * np.pi, (1.0, 0.0, 0.0)))
    boundary_of(BOX, [LAYER], [solid(tub, SHELL, container=True)])
    flat = np.radians(1.0)
    x = np.linspace(-0.3, 0.3, 40)
    r = np.tile((0.0, -np.sin(flat), -np.cos(flat)), (len(x), 1))
    p = SHELL + (TUB_LID - 0.002) * np.array((0.0, 1.0, 0.0)) + x[:, None] * np.eye(3)[0]
    expected = np.sqrt(TUB**2 - x**2) / np.cos(flat)
    assert rays_of.trace(p, r)[0] == pytest.approx(expected, abs=0.02)


@pytest.mark.parametrize("height", [0.25, 0.5])
def test_a_ball_shades_the_floor_with_a_penumbra_in_proportion_to_its_distance(
    picture, lit, height
):
    """The middle of the shadow is dark, and half of the light passes at its outline."""
    middle = np.array((0.5, 0.0, 0.5))
    sun = Look().sun_direction()
    draw_bodies(picture, [Ball(middle + sun * height / sun[1], RADIUS)])
    # Across the light, the outline of the shadow is a circle of the ball's radius.
    across = unit(np.cross(sun, (0.0, 1.0, 0.0))[None])
    x = np.linspace(-0.4, 0.4, 801)
    share = lit.at(middle + x[:, None] * across)
    width = height / sun[1] / SHARPNESS
    assert share[abs(x) < RADIUS - width].max(initial=0.0) < 0.1
    assert share[abs(x) > RADIUS + width].min() > 0.95
    assert abs(share - 0.5)[abs(abs(x) - RADIUS) < 0.003].max() < 0.3
    assert abs(np.diff(share)).max() < 0.1


def test_the_lit_side_of_a_body_is_not_in_its_own_shadow(picture, lit):
    draw_bodies(picture, [Ball(BALL, RADIUS), Block(*np.array(PLINTH))])
    sun = picture.lens.numbers["sun"]
    n = unit(np.random.default_rng(5).normal(size=(2000, 3)))
    share, facing = lit.at(BALL + RADIUS * n), n @ sun
    assert share[facing > 0.3].min() > 0.9
    assert np.percentile(share[facing < -0.5], 95) < 0.2


def test_triangles_of_bodies_enclose_their_volume():
    block, ball = Block(*np.array(PLINTH)), Ball(BALL, RADIUS)
    for body, volume in ((block, 0.2 * 0.5 * 0.4), (ball, 4.0 / 3.0 * np.pi * RADIUS**3)):
        found = np.linalg.det(triangles_of(body)).sum() / 6.0
        assert found == pytest.approx(volume, rel=3e-3)


def unit(v):
    return v / np.linalg.norm(v, axis=1, keepdims=True)


def test_a_body_hides_water_behind_it_but_not_in_front_of_it(picture):
    view = framing(0.0, 0.2)
    draw_bodies(picture, [Ball(np.array((0.5, 0.5, 0.5)), 0.2)], view)
    dry = picture.image.to_numpy()
    shot, depth = picture.lens.numbers, body_depth(picture)
    near, _ = sphere(shot["eye"], rays(shot, WIDTH, HEIGHT), np.array((0.5, 0.5, 0.5)), 0.2)
    inside, found = np.isfinite(near), depth < 100.0
    assert abs(found.sum() - inside.sum()) < 0.05 * inside.sum()
    assert depth[inside & found] == pytest.approx(near[inside & found], abs=0.01)
    # A drop behind the ball does not change the image, a drop in front of it does.
    for z, shown in ((0.15, False), (0.85, True)):
        place = view.eye + (0.5 - view.eye) * (view.eye[2] - z) / (view.eye[2] - 0.5)
        draw(picture, view, ball(place, 0.06))
        drop = covered(picture.raster, WIDTH, HEIGHT)
        assert (drop & inside).sum() > 5
        changed = abs(picture.image.to_numpy() - dry).max(axis=-1) > 1e-3
        assert changed[drop & inside].mean() > 0.5 if shown else not changed[inside].any()


def test_the_light_of_a_body_is_in_proportion_to_its_albedo(picture):
    """What a black body shows is the reflection of the glass in front of it."""
    centre, radius = np.array((0.5, 0.5, 0.5)), 0.2
    shown = []
    for albedo in (None, (0.3, 0.5, 0.1), (0.0, 0.0, 0.0)):
        draw_bodies(picture, [Ball(centre, radius, albedo=albedo)], framing(0.0, 0.2))
        shown.append(linear(picture.image.to_numpy()))
    shot = picture.lens.numbers
    near, _ = sphere(shot["eye"], rays(shot, WIDTH, HEIGHT), centre, 0.6 * radius)
    clay, painted, black = (s[np.isfinite(near)] for s in shown)
    assert len(clay) > 50 and black.max() < 0.1
    expected = black + (clay - black) * np.array((0.3, 0.5, 0.1)) / np.array(CLAY)
    # Darker blocks of pixels are interpolated sooner.
    assert np.percentile(abs(painted - expected), 75) < 0.005
    assert painted.mean(axis=0) == pytest.approx(expected.mean(axis=0), rel=0.03)


def test_a_lattice_of_colours_has_the_colour_of_each_side():
    """Across a side of a cube, colours change within a cell of the edge between them."""
    box = trimesh.creation.box((0.4, 0.3, 0.2))
    top = box.face_normals[:, 1] > 0.5
    paint = np.where(top[:, None], (0.9, 0.6, 0.0), (0.1, 0.1, 0.2))
    low, cell, colours = lattice(box.triangles, paint, 20_000)
    assert colours[..., 0].size <= 20_000
    x, side = trimesh.sample.sample_surface(box, 2000, seed=1)
    inner = x[:, 1] < 0.15 - 2.0 * cell
    nearest = np.round((x - low) / cell).astype(int)
    found = colours[tuple(nearest.T)]
    clear = top[side] & (abs(x[:, [0, 2]]) < (0.2 - 2.0 * cell, 0.1 - 2.0 * cell)).all(axis=1)
    assert clear.sum() > 200 and (inner & ~top[side]).sum() > 200
    assert found[clear] == pytest.approx(np.tile((0.9, 0.6, 0.0), (clear.sum(), 1)))
    sides = inner & ~top[side]
    assert found[sides] == pytest.approx(np.tile((0.1, 0.1, 0.2), (sides.sum(), 1)))


def test_a_painted_body_shows_the_colours_of_its_triangles(picture):
    """A cube with a black front and white other sides, in the eye's rays."""
    box = trimesh.creation.box((0.4, 0.4, 0.4))
    front = box.face_normals[:, 2] > 0.5
    paint = np.where(front[:, None], (0.02, 0.02, 0.02), (0.9, 0.9, 0.9))
    cube = solid(box, (0.5, 0.4, 0.5), paint=paint)
    draw_bodies(picture, [cube], framing(0.0, 0.5))
    image, depth = linear(picture.image.to_numpy()), body_depth(picture)
    light = image[depth < 100.0].mean(axis=-1)
    dark = light < 0.2
    assert 0.2 < dark.mean() < 0.8 and np.median(light[~dark]) > 4.0 * np.median(light[dark])


def test_the_waterline_at_a_container_is_exact(picture, boundary):
    """The mesh extends beyond the sides of the container, as meshes for images do."""
    level = 0.4
    picture.load(WIDTH, HEIGHT, BOX)
    draw(picture, framing(0.3, 0.35), still_water(level))
    d = unit(rays(picture.lens.numbers, WIDTH, HEIGHT).reshape(-1, 3))
    eye = picture.lens.numbers["eye"]
    near, far = sphere(eye, d, SHELL, ROOM)
    on_ball, _ = sphere(eye, d, BALL, 1.2 * RADIUS)
    down = (level - eye[1]) / d[:, 1]
    wet = (down < near) | ((down > near) & (down < far))
    # The icosphere lies inside the sphere by up to 1 % of its radius; pixels are 0.02 m wide.
    edge = np.minimum(abs(down - near), abs(down - far)) * abs(d[:, 1]) < 0.03
    sure = np.isnan(near) | ((far - near > 0.3) & ~edge & np.isnan(on_ball))
    found = covered(picture.raster, WIDTH, HEIGHT).ravel()
    hidden = body_depth(picture).ravel()
    depth = down * (d @ picture.lens.numbers["forward"])
    found &= ~((down > near) & (hidden < depth))
    assert np.isnan(near)[sure].sum() > 1000 and wet[sure].sum() > 100
    assert (~wet & np.isfinite(near))[sure].sum() > 100
    assert np.array_equal(found[sure], wet[sure])
    side = items(picture.raster, WIDTH, HEIGHT).ravel() == picture.raster.wet[None]
    assert np.array_equal(side[sure & wet], (down < near)[sure & wet])


def test_a_body_has_no_film_of_water_where_the_glass_cuts_it(picture):
    """Regression: near its edges, where the nearest side faced away, the body reflected the sky."""
    lo, hi = np.array((-0.5, -0.5, -0.5)), np.array((0.4, 0.9, 1.5))
    view, images = framing(0.25, 0.1), []
    view.target = np.array((0.4, 0.4, 1.0))
    view.zoom(0.05)
    draw_bodies(picture, [Block(lo, hi)], view)
    for wet in (0.0, 1.0):
        picture.wetness.wet.fill(wet)
        picture.view = None
        picture.draw_water(view)
        images.append(picture.image.to_numpy())
    d, eye = rays(picture.lens.numbers, WIDTH, HEIGHT), picture.lens.numbers["eye"]
    x = (eye + d * ((1.0 - eye[2]) / d[..., 2])[..., None])[..., 0]
    pixel = np.diff(x, axis=0).max()
    cut = x < hi[0] - 2.0 * pixel
    # The only difference is the reflection of the wet pane.
    assert cut.sum() > 50 and abs(images[1] - images[0])[cut].max() < 0.045


def test_moving_bodies_redraw_their_surroundings_only(picture):
    """Images equal images that are rendered completely, in water of varying level."""
    swinging = Motion(swing=(0.3, -0.3, 0.2), period=1.0)
    bodies = [Ball(np.array((0.4, 0.5, 0.5)), 0.08, motion=swinging), Block(*np.array(PLINTH))]
    body, mesh = boundary_of(BOX, [LAYER], bodies), picture.mesh
    picture.load(4 * WIDTH, 4 * HEIGHT, BOX, Look(drying=0.0))
    view = framing(0.5, 0.5)

    def image(frame, whole):
        mesh.fill(*still_water(0.3 + 0.27 * np.sin(2.0 * frame)))
        if frame % 4 == 3:
            mesh.counts.fill(0)  # the shadow falls on a dry floor
        picture.view = None if whole else picture.view
        picture.draw_water(view)
        marks = picture.backdrop.moved.marks.to_numpy()
        marks = marks[: 4 * WIDTH // COARSE, : 4 * HEIGHT // COARSE]
        return picture.image.to_numpy(), (marks > 0).mean()

    found = []
    for whole in (False, True):
        body.reset(0.0)
        image(0, True)
        for frame in range(12):
            # Some movements are too small to be seen.
            body.move(0.13 if frame % 3 else 1e-8)
            found.append(image(frame, whole))
    for (partly, share), (wholly, _) in zip(found[:12], found[12:], strict=True):
        np.testing.assert_allclose(partly, wholly, atol=2e-3)
        assert share < 0.6
    assert np.abs(found[0][0] - found[11][0]).max() > 0.2


def test_a_ball_seen_through_the_glass_from_below_has_no_step_at_its_waterline(picture):
    """Regression: the ball that the surface reflects was shaded as if inside, in shadow."""
    level = 0.4
    view = framing(0.0, -0.45)
    view.target = np.array((0.5, level, 0.5))
    view.zoom(0.5)
    draw_bodies(picture, [Ball(np.array((0.5, 0.3, 0.4)), 0.3)], view, still_water(level, n=32))
    rows = covered(picture.raster, WIDTH, HEIGHT)[WIDTH // 2]
    red, green, _ = colours(picture.fields.canvas.to_numpy()[WIDTH // 2, :HEIGHT][rows]).T
    clay = red > 0.8 * green
    assert 30 < clay.sum() < rows.sum() and abs(np.diff(red[clay])).max() < 0.02
