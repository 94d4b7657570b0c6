"""Tests of the legend: rounded, steady ranges and the panel that shows them."""

import numpy as np
import pytest
import taichi as ti

from msph.picture.legend import Legend, LegendPanel, paint
from msph.picture.particles_view import colour_map, shown_colour
from msph.picture.pixels import Image
from msph.picture.ranges import SteadyRange, nice
from msph.picture.tone import curve

SPEED = Legend("speed [m/s]", ((0.0, "0"), (1.0, "2")))
LAYERS = Legend("layers: spacing [mm]", ((0.0, "28"), (0.5, "35.3"), (1.0, "44.4")), bar=False)


@pytest.mark.parametrize(
    ("value", "expected"),
    [(0.0, 0.0), (-3.0, 0.0), (1.0, 1.0), (1.01, 2.0), (0.03, 0.05), (4999.0, 5000.0), (6e6, 1e7)],
)
def test_nice_numbers_are_1_2_and_5_times_powers_of_ten(value, expected):
    assert nice(value) == pytest.approx(expected)


@pytest.mark.parametrize("power", range(-6, 7))
def test_nice_numbers_are_not_changed_by_rounding(power):
    for m in (1.0, 2.0, 5.0):
        assert nice(m * 10.0**power) == pytest.approx(m * 10.0**power)


def test_range_grows_at_once_and_shrinks_late():
    speed = SteadyRange(least=0.1)
    tops = [speed.cover(0.0, top)[1] for top in (0.0, 0.9, 1.1, 0.9, 0.7, 0.6, 0.9, 4.0, 1.9, 0.01)]
    assert tops == pytest.approx([0.1, 1.0, 2.0, 2.0, 2.0, 1.0, 1.0, 5.0, 5.0, 0.1])


def test_range_is_steady_while_values_fluctuate():
    for value in np.geomspace(0.3, 30.0, 40):
        steady = SteadyRange(least=0.0)
        shaken = [steady.cover(0.0, value * f)[1] for f in (1.0, 1.2, 1.0, 0.9, 1.2, 0.95, 1.0)]
        assert len(set(shaken[1:])) == 1


def test_negative_values_set_the_lower_end_of_the_range():
    pressure = SteadyRange(least=10.0)
    assert pressure.cover(-30.0, 40.0) == pytest.approx((-50.0, 50.0))
    assert pressure.cover(-30.0, 4000.0) == pytest.approx((-500.0, 5000.0))


def test_legend_has_the_colours_of_the_particles():
    assert np.array_equal(shown_colour(np.array([0.0, 1.0])), curve(colour_map())[[0, -1]])


@pytest.mark.parametrize("legend", [SPEED, LAYERS])
def test_panel_has_text_on_a_dark_background_and_the_colours(legend):
    panel = paint(legend, 16)
    assert panel.dtype == np.uint8 and panel.shape[2] == 4
    assert panel[0, 0, :3].max() < 60 and 100 < panel[0, 0, 3] < 200
    title = panel[: 2 * 16, :, :3]
    assert 0.01 < (title > 180).all(-1).mean() < 0.4
    for place in (0.0, 1.0):
        colour = 255 * shown_colour(place)
        assert (np.abs(panel[..., :3] - colour).max(-1) < 4).sum() > 10


def test_number_that_would_overlap_another_is_left_out():
    apart = ((0.0, "-5"), (1.0, "5"))
    middle, near = (paint(Legend("p", (*apart, (place, "0"))), 16) for place in (0.5, 0.05))
    assert not np.array_equal(middle, paint(Legend("p", apart), 16))
    assert np.array_equal(near, paint(Legend("p", apart), 16))


def test_blending_changes_only_the_panels_rectangle():
    panel = LegendPanel(320, 180)
    image = Image(ti.Vector.field(3, ti.f32, (320, 180)), 320, 180)
    for legend in (LAYERS, SPEED):
        image.field.fill(0.8)
        panel.draw(legend, image)
        _, _, width, height = panel.overlay.shown["legend"]
        expected = paint(legend, panel.size)
        assert expected.shape[:2] == (height, width)
        changed = np.abs(image.to_numpy() - 0.8).max(-1) > 1e-6
        inside = np.zeros_like(changed)
        right = 320 - panel.gap
        inside[right - width : right, panel.gap : panel.gap + height] = True
        assert not changed[~inside].any() and changed[inside].mean() > 0.9
        shown = image.to_numpy()[inside].reshape(width, height, 3).transpose(1, 0, 2)[::-1]
        opacity = expected[..., 3:] / 255
        blended = 0.8 * (1 - opacity) + opacity * expected[..., :3] / 255
        assert np.abs(shown - blended).max() < 1e-5


def test_panel_is_cropped_to_a_small_image():
    panel, image = LegendPanel(64, 36), Image(ti.Vector.field(3, ti.f32, (64, 36)), 64, 36)
    panel.draw(LAYERS, image)
    left, low, width, height = panel.overlay.shown["legend"]
    assert left >= panel.gap and width <= 64 - 2 * panel.gap
    assert low >= panel.gap and height <= 36 - 2 * panel.gap
