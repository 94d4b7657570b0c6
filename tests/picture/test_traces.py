"""Tests of the traces of water: wet walls, and ripples where the surface is disturbed."""

import numpy as np
from picture_kit import BOX, HEIGHT, LEVEL, WIDTH, canvas_of, draw, still_water

from msph.fluid.external_forces import Hand
from msph.launches import watch_compiling
from msph.picture.camera import Camera
from msph.picture.look import Look
from msph.picture.ripples import CELLS, DAMPING, SPEED

VIEW = Camera.framing(BOX, WIDTH / HEIGHT)
SPACING = 1.0 / 8.0  # distance between vertices of still water [m]
HAND = Hand(position=(0.5, LEVEL, 0.5), velocity=(1.0, 0.0, 0.0), radii=(0.2,) * 3, grip=60.0)


def shown(picture, level):
    """Returns the image of still water up to a level [m]."""
    draw(picture, VIEW, still_water(level))
    return canvas_of(picture)


def test_frames_after_the_second_compile_no_kernels_but_the_later_ones(picture):
    for _ in range(2):
        picture.advance(1.0 / 60.0, Hand())
        shown(picture, LEVEL)
    for compile_kernel in picture.later_kernels():
        compile_kernel()
    compiled = []
    with watch_compiling(compiled.append):
        for _ in range(20):
            picture.advance(1.0 / 60.0, HAND)
            shown(picture, 0.5 * LEVEL)
    assert compiled == []


def test_walls_are_darker_where_water_has_been_until_they_are_dry(picture):
    picture.load(WIDTH, HEIGHT, BOX, Look(drying=3.0, caustics=False), spacing=SPACING)
    dry = shown(picture, 0.1)
    shown(picture, 0.5)
    picture.advance(0.25, Hand())
    wet = shown(picture, 0.1)
    lost = (dry - wet).mean(axis=-1)
    assert lost.max() > 0.025 and lost.min() > -0.05
    column = lost[WIDTH // 2 - 40]  # far wall: dark above the low level, dry above the high level
    assert (abs(column[-20:]) < 1e-3).all()
    for _ in range(20):
        picture.advance(0.25, Hand())
        last = shown(picture, 0.1)
    assert abs(last - dry).max() < 0.01


def test_wet_walls_have_no_holes_and_end_without_steps(picture):
    """Regression: with cells smaller than the mesh's, wet or dry, stains were blotches."""
    picture.load(WIDTH, HEIGHT, BOX, Look(), spacing=SPACING)
    heights = []
    for level in (0.52, 0.53, 0.54):
        picture.reset()
        shown(picture, level)
        across, _, along = picture.wetness.numbers.last.to_numpy().astype(int)
        wall = picture.wetness.wet.to_numpy()[across, :, : along + 1]
        assert wall[:3].min() > 0.9  # under water
        heights.append(wall.sum(axis=0))
    assert np.ptp(heights, axis=1).max() < 0.25
    assert (np.diff(heights, axis=0) > 0.01).any(axis=0).all()


def test_without_drying_time_nothing_is_wet(picture):
    picture.load(WIDTH, HEIGHT, BOX, Look(drying=0.0, caustics=False))
    dry = shown(picture, 0.1)
    shown(picture, 0.5)
    picture.advance(0.25, Hand())
    assert np.array_equal(shown(picture, 0.1), dry)
    assert picture.wetness.wet.to_numpy().max() == 0.0


def test_a_hand_makes_ripples_only_near_it_and_they_decay(picture):
    picture.load(WIDTH, HEIGHT, BOX, Look(caustics=False))
    calm = shown(picture, LEVEL)
    for _ in range(20):
        picture.advance(1.0 / 60.0, HAND)
    disturbed = shown(picture, LEVEL)
    h = picture.ripples.height.to_numpy()
    x, z = np.meshgrid(*[(np.arange(CELLS) + 0.5) / CELLS] * 2, indexing="ij")
    away = np.hypot(x - 0.5, z - 0.5)
    assert abs(h[away < 0.15]).max() > 1e-4
    assert abs(h[away > 0.2 + 20 / 60 * SPEED + 0.02]).max() < 1e-9
    changed = abs(disturbed - calm).max(axis=-1) > 0.005
    assert 0.0005 < changed.mean() < 0.3
    for _ in range(round(12 * DAMPING * 60)):
        picture.advance(1.0 / 60.0, Hand())
    assert abs(shown(picture, LEVEL) - calm).max() < 0.01
    assert abs(picture.ripples.height.to_numpy()).max() < 1e-4


def test_ripples_after_a_reset_repeat(picture):
    """Regression: the seed of the chop around a hand was not reset."""
    picture.load(WIDTH, HEIGHT, BOX, Look(caustics=False))
    heights = []
    for _ in range(2):
        picture.reset()
        shown(picture, LEVEL)
        for _ in range(3):
            picture.advance(1.0 / 60.0, HAND)
        heights.append(picture.ripples.height.to_numpy())
    assert heights[0].any() and np.array_equal(*heights)


def test_ripples_can_be_switched_off(picture):
    picture.load(WIDTH, HEIGHT, BOX, Look(ripples=False))
    shown(picture, LEVEL)
    picture.advance(1.0 / 60.0, HAND)
    assert abs(picture.ripples.height.to_numpy()).max() == 0.0
