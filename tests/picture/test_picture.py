import numpy as np
import pytest
import taichi as ti
from picture_kit import (
    BOX,
    HEIGHT,
    LEVEL,
    WIDTH,
    backdrop_of,
    ball,
    canvas_of,
    covered,
    draw,
    join,
    still_water,
)

from msph.picture import samples
from msph.picture.camera import Camera
from msph.picture.look import Look
from msph.picture.picture import Picture
from msph.picture.shot import CAUSTIC_CELLS

TILT = np.array([[np.cos(0.2), -np.sin(0.2), 0], [np.sin(0.2), np.cos(0.2), 0], [0, 0, 1]])


def camera(azimuth=0.6, elevation=0.34):
    return Camera.framing(BOX, WIDTH / HEIGHT, azimuth, elevation)


def test_water_changes_only_the_pixels_it_covers(picture):
    draw(picture, camera(), still_water())
    image, seen = canvas_of(picture), covered(picture.raster)
    assert 0.1 < seen.mean() < 0.5
    assert np.isfinite(image).all() and image.min() >= 0 and image.max() <= 1
    change = np.abs(image - backdrop_of(picture)[..., :3]).max(-1)
    assert (change[~seen] == 0).all() and change[seen].mean() > 0.02


def test_top_of_the_image_is_sky(picture):
    draw(picture, camera(elevation=0.06))
    shown = picture.to_numpy_u8()
    assert shown.shape == (HEIGHT, WIDTH, 3) and shown.dtype == np.uint8
    top, bottom = shown[2].mean(0), shown[-2].mean(0)
    assert top[2] > top[0] + 20, "sky is blue"
    assert bottom[0] >= bottom[2], "ground is not"


def test_tilt_turns_the_box_but_not_the_sky(picture):
    view = camera(elevation=0.06)
    draw(picture, view)
    level = picture.image.to_numpy()
    picture.draw_water(view, TILT)
    tilted = picture.image.to_numpy()
    sky = slice(0, 30), slice(HEIGHT - 30, HEIGHT)
    np.testing.assert_allclose(tilted[sky], level[sky], atol=0.02)
    assert (np.abs(tilted - level).max(-1) > 0.1).mean() > 0.05


@pytest.mark.parametrize("tilt", [None, TILT])
def test_pick_finds_the_surface_under_the_pixel(picture, tilt):
    view = camera(elevation=0.7)
    draw(picture, view, still_water(), tilt)
    i, j = WIDTH // 2 + 10, HEIGHT // 2 + 8
    got = picture.pick(i, j)
    eye, d = view.box_ray(i, j, WIDTH, HEIGHT, BOX, tilt)
    want = eye + d * (LEVEL - eye[1]) / d[1]
    np.testing.assert_allclose(got, want, atol=2e-4)
    assert picture.pick(0, HEIGHT - 1) is None and picture.pick(-1, 5) is None


def apparent_rows(view, z, level):
    """Returns the pixel heights j in the middle column where floor lines at z appear under water.

    The ray meets the surface at the distance s from the point below the eye. Snell's law is solved
    for s by bisection.
    """
    shot_eye = view.eye
    rows = []
    for target in z:
        far, h = shot_eye[2] - target, shot_eye[1] - level
        lo, hi = 0.0, far
        for _ in range(60):
            s = (lo + hi) / 2
            sine = s / np.hypot(s, h) / Look().refractive_index
            lo, hi = (s, hi) if s + level * sine / np.sqrt(1 - sine**2) < far else (lo, s)
        p = np.array((shot_eye[0], level, shot_eye[2] - s)) - shot_eye
        _, up, back = view.axes()
        step = 2 * np.tan(view.fov / 2) / HEIGHT
        rows.append((p @ up) / -(p @ back) / step + HEIGHT / 2 - 0.5)
    return np.array(rows)


def test_tile_joints_under_water_appear_where_snells_law_predicts(picture):
    view = Camera(np.array((0.5, 0.2, 0.5)), 0.0, 0.9, 1.6, 0.6)
    draw(picture, view, still_water())
    tiles = picture.lens.numbers["tiles"][2]
    joints = np.arange(4, 9) / tiles
    # The middle column is a joint; the columns next to it are read.
    light = picture.image.to_numpy()[WIDTH // 2 + 4 : WIDTH // 2 + 8].sum((0, 2))

    def contrast(level):
        """Returns the mean brightness at the predicted joints minus at the middles of tiles."""
        at = np.arange(HEIGHT)
        on = np.interp(apparent_rows(view, joints, level), at, light)
        off = np.interp(apparent_rows(view, joints + 0.5 / tiles, level), at, light)
        return on.mean() - off.mean()

    assert contrast(LEVEL) > 0.3
    assert contrast(0.0) < 0.5 * contrast(LEVEL), "rays bend at the water"


def test_deeper_water_is_bluer(picture):
    view = camera(elevation=1.2)
    redness = []
    for level in (0.1, 0.6):
        draw(picture, view, still_water(level))
        c = picture.image.to_numpy()[WIDTH // 2 - 10 : WIDTH // 2 + 10, HEIGHT // 2].mean(0)
        redness.append(c[0] / c[2])
    assert redness[1] < 0.8 * redness[0]


def test_still_water_does_not_focus_light(picture):
    draw(picture, camera(), still_water())
    focus, shot = picture.sunlight.focus.to_numpy(), picture.lens.numbers
    cells = CAUSTIC_CELLS
    xz = (
        shot["map_corner"]
        + (np.indices((cells, cells)).transpose(1, 2, 0) + 0.5) / shot["map_scale"]
    )
    came_in = xz - shot["drift"] * LEVEL
    lit = ((came_in > 0.05) & (came_in < 0.95)).all(-1)
    np.testing.assert_allclose(focus[lit], 1, atol=0.02)


def test_a_hill_of_water_focuses_light_and_keeps_its_amount(picture):
    v, t, n = still_water(n=24)
    x, z = v[:, 0] - 0.5, v[:, 2] - 0.5
    top = n[:, 1] > 0.5
    a, s = 0.02, 0.15  # height and width [m] of a hill of water
    hill = a * np.exp(-(x**2 + z**2) / s**2)
    slope = np.stack([2 * x / s**2 * hill, np.ones_like(x), 2 * z / s**2 * hill], 1)
    v[top, 1] += hill[top]
    n[top] = (slope / np.linalg.norm(slope, axis=1, keepdims=True))[top]
    draw(picture, camera(), (v, t, n))
    focus, lit = picture.sunlight.focus.to_numpy(), picture.image.to_numpy()
    picture.change(Look(caustics=False))
    picture.draw_water(camera())
    assert np.abs(lit - picture.image.to_numpy()).max() > 0.1, "the floor shows the light"
    picture.change(Look())
    draw(picture, camera(), still_water(n=24))
    still = picture.sunlight.focus.to_numpy()
    assert focus.max() > 1.4
    assert focus.sum() == pytest.approx(still.sum(), rel=0.03)


def test_level_map_ignores_drops_above_the_water(picture):
    draw(picture, camera(), join([still_water(n=32), ball((0.5, 0.6, 0.5), 0.05)]))
    level = picture.sunlight.level.to_numpy()
    assert level[level > 0].max() == pytest.approx(LEVEL, abs=1e-3)


@pytest.fixture(scope="module")
def particles(taichi_runtime):
    x, value, radius = ti.Vector.field(3, ti.f32, 64), ti.field(ti.f32, 64), ti.field(ti.f32, 64)
    return x, value, radius


def test_the_level_map_has_no_gaps_under_a_coarse_mesh(picture):
    """Regression: dark lines on the floor of `still`, where columns between vertices were dry."""
    picture.load(WIDTH, HEIGHT, BOX, spacing=1 / 8)
    draw(picture, camera(), still_water(n=8))
    nx, nz = picture.lens.numbers["level_cells"].astype(int)
    level = picture.sunlight.level.to_numpy()[:nx, :nz]
    np.testing.assert_allclose(level, LEVEL, atol=1e-6)


def test_bubbles_whiten_thin_water_in_the_air_but_not_a_lump(picture):
    centre, found = np.array((0.5, 0.45, 0.5)), []
    picture.load(WIDTH, HEIGHT, BOX, Look(refractive_index=1.0, reflection=0.0, tint=0.0))
    for radius in (0.02, 0.15):
        view = Camera(centre, 0.6, 0.3, 10.0 * radius, 0.3)
        draw(picture, view)
        empty = canvas_of(picture)
        draw(picture, view, ball(centre, radius))
        change = (canvas_of(picture) - empty).mean(-1)
        i, j = np.nonzero(covered(picture.raster))
        inside = np.hypot(i - i.mean(), j - j.mean()) < 0.5 * (np.ptp(i) / 2)
        found.append(change[i[inside], j[inside]].mean())
    assert found[0] > 0.1 and found[1] < 0.01, found


def test_the_nearer_particle_hides_the_farther_particle(picture, particles):
    x, value, radius = particles
    view = camera()
    middle = np.array(BOX) / 2
    toward = (view.eye - middle) / np.linalg.norm(view.eye - middle)
    places, values = np.zeros((64, 3), np.float32), np.zeros(64, np.float32)
    places[0], places[1], places[2] = middle, middle + 0.3 * toward, (0.5, 0.65, 0.5)
    values[:3] = 0.0, 1.0, 0.0
    radii = np.full(64, 0.2, np.float32)
    radii[1] = 0.1
    x.from_numpy(places)
    value.from_numpy(values)
    radius.from_numpy(radii)
    picture.draw_particles(view, None, x, value, 0.0, 1.0, 2, radius)
    image = picture.image.to_numpy()
    front = image[WIDTH // 2, HEIGHT // 2]
    assert front[0] > front[2], "the near particle has the map's yellow end"
    seen = covered(picture.raster)
    beside = image[seen & (image[..., 2] > image[..., 0] + 0.1)]
    assert len(beside) > 100, "the far particle is dark blue around the near one"
    picture.draw_particles(view, None, x, value, 0.0, 1.0, 3, radius)
    assert covered(picture.raster).sum() > seen.sum(), "the count is an argument"
    radius.fill(0.0)
    picture.draw_particles(view, None, x, value, 0.0, 1.0, 3, radius)
    assert not covered(picture.raster).any(), "without a radius they are hidden"


def test_supersampling_averages_the_same_image(picture):
    picture.load(WIDTH // 2, HEIGHT // 2, BOX, Look(supersample=2, caustics=False))
    picture.sunlight.focus.fill(0.0)
    draw(picture, camera(), still_water())
    assert not picture.sunlight.focus.to_numpy().any(), "caustics cost nothing when off"
    fine, picked = picture.image.to_numpy(), picture.pick(80, 50)
    picture.load(WIDTH, HEIGHT, BOX)
    picture.draw_water(camera())
    coarse = canvas_of(picture).reshape(WIDTH // 2, 2, HEIGHT // 2, 2, 3).mean((1, 3))
    dry = ~covered(picture.raster).reshape(WIDTH // 2, 2, HEIGHT // 2, 2).any((1, 3))
    np.testing.assert_allclose(fine[dry], coarse[dry], atol=2e-3)
    np.testing.assert_allclose(picked, picture.pick(160, 100), atol=1e-5)


def test_backdrop_left_out_under_water_does_not_change_the_image(picture):
    """The first frame of a view leaves out hidden tiles, the second renders them."""
    view = camera(azimuth=0.8)
    draw(picture, view, still_water())
    first, partly = picture.image.to_numpy(), backdrop_of(picture)
    picture.draw_water(view)
    second, whole = picture.image.to_numpy(), backdrop_of(picture)
    np.testing.assert_array_equal(first, second)
    seen = covered(picture.raster)
    assert (partly[~seen] == whole[~seen]).all() and np.abs(partly - whole)[seen].max() > 0.05
    np.testing.assert_array_equal(partly[..., 3], whole[..., 3], "edges before the water")
    # Without water, the tiles that it hid are visible.
    draw(picture, view)
    assert not covered(picture.raster).any()
    np.testing.assert_array_equal(canvas_of(picture), whole[..., :3])


@pytest.fixture(scope="module")
def every_pixel(mesh):
    """Returns a picture that samples every pixel of the water."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(samples, "MAX_ADDED_CHANGE", -1.0)  # below 0 no block is even
        drawn = Picture(mesh)
        drawn.load(WIDTH, HEIGHT, BOX)
        drawn.draw_water(camera())
    return drawn


@pytest.mark.slow
@pytest.mark.parametrize("size", [(0.02, 25.0), (0.004, 90.0)])
def test_means_in_even_blocks_are_close_to_samples_of_every_pixel(picture, every_pixel, mesh, size):
    height, number = size
    v, t, n = still_water(n=36)
    top = n[:, 1] > 0.5
    phase = number * (v[:, 0] + 0.4 * v[:, 2])
    slope = height * number * np.cos(phase)
    v[top, 1] += (height * np.sin(phase))[top]
    n[top] = np.stack([-slope, np.ones_like(slope), -0.4 * slope], 1)[top]
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    mesh.fill(v, t, n)
    shown = []
    for drawn in (picture, every_pixel):
        drawn.draw_water(camera(elevation=0.6))
        shown.append(drawn.to_numpy_u8().astype(int))
    change = np.abs(shown[0] - shown[1])
    assert 0.0 < change.mean() < 1.0 and np.percentile(change, 99.0) < 8.0


def test_background_is_a_gradient_where_nothing_is_drawn(picture):
    low, high = (0.9, 0.2, 0.4), (0.1, 0.6, 1.0)
    picture.load(WIDTH, HEIGHT, BOX, Look(background=low, background_top=high))
    draw(picture, Camera.framing(BOX))
    shown = picture.image.to_numpy()
    for i in (0, WIDTH - 1):
        assert shown[i, 0] == pytest.approx(low, abs=0.01)
        assert shown[i, HEIGHT - 1] == pytest.approx(high, abs=0.02)
        assert (np.diff(shown[i, :, 1]) >= -1e-3).all()
