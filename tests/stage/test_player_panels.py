"""Tests of a player's hints, pages, panels and views: keys and gestures, and what they show."""

import math
import re

import imageio.v2 as imageio
import numpy as np
import pytest

from msph.fluid.particles.layers import pair_support
from msph.picture.camera import Camera
from msph.scene.library import shipped_scenes
from msph.scene.live import read
from msph.scene.load import read_toml
from msph.stage import menu, pages
from msph.stage.choice import Choice
from msph.stage.display import BELOW
from msph.stage.keys import ACTIONS, KEYS
from msph.stage.layout import GAP, HINTS, PAGES, PANELS, errors_of
from msph.stage.player import Player
from msph.stage.row import Row
from msph.stage.sheet import Slider, text_height
from tests.fluid.fluid_kit import quartic
from tests.stage.player_kit import HEIGHT, WIDTH, frames, played, press


def widgets(player):
    """Returns the widgets of the open panel."""
    return player.layout.pages["settings"].sheet.widgets


def point(player, widget, share=0.5):
    """Moves the cursor to a share of the width of a widget of the open panel."""
    x = widget.left + share * (widget.right - widget.left)
    y = HEIGHT - player.layout.column_size[1] + 0.5 * (widget.top + widget.bottom)
    player.window.at = np.array([x / WIDTH, 1.0 - y / HEIGHT])


def click(player, name):
    """Clicks on a button of the open panel."""
    point(player, next(b for b in widgets(player) if b.name == name))
    with player.window.holding("LMB"):
        press(player, "LMB")
    frames(player, 2)


def move(player, key, value):
    """Drags a slider of the open panel from its left end to a value."""
    slider = next(s for s in widgets(player) if s.name == key)
    point(player, slider, 0.0)
    with player.window.holding("LMB"):
        press(player, "LMB")
        point(player, slider, (value - slider.lo) / (slider.hi - slider.lo))
        frames(player, 2)
    frames(player)


def test_hints_disappear_once_they_were_tried(player):
    everything = frames(player, 2)
    low = slice(0, HEIGHT // 5)
    for key in KEYS:
        if key.hint:
            player.idle.tried |= set(key.keys.values())
    nothing = frames(player)
    assert "hints" not in player.layout.overlay.shown
    assert np.abs(everything[: WIDTH // 2, low] - nothing[: WIDTH // 2, low]).mean() > 0.01


@pytest.mark.parametrize("panel", PANELS)
@pytest.mark.parametrize("view", ["water", "layers"])
def test_a_message_covers_neither_hints_nor_legend(player, show, view, panel):
    """Regression: a long message covered the legend while the settings were open."""
    layout = player.layout
    layout.panel, show.display.views.name = panel, view
    frames(player)
    layout.show_message("the water is held " + "where the cursor was last seen, " * 3 + "until now")
    frames(player)
    left, low, width, height = layout.overlay.shown["message"]
    hints = layout.overlay.shown["hints"]
    assert low >= hints[1] + hints[3] and low + height <= HEIGHT
    free = layout.free * WIDTH
    assert left >= WIDTH - free
    assert left + width <= WIDTH - free + free * (HINTS if view == "layers" else 1.0)


@pytest.mark.parametrize("box", [(1.2, 0.4, 0.4), (1.0, 1.0, 1.0), (0.5, 2.0, 0.5)])
def test_hints_do_not_cover_the_box(box):
    """Regression: the line of hints covered the box's lowest corner."""
    width, height = 960, 540
    text = text_height(height)
    sheet = pages.hints([key.hint for key in KEYS if key.hint], False, text, width)
    corners = np.indices((2, 2, 2)).reshape(3, 8).T * box
    camera = Camera.framing(box, width / height, below=BELOW)
    lowest = camera.project(corners, width, height, box)[:, 1].min()
    assert round(GAP * text) + sheet.size[1] < height * lowest


def test_help_covers_the_image_until_it_is_closed(player):
    player.idle.tried |= set(ACTIONS.values())
    press(player, " ")
    without = frames(player)
    assert np.abs(press(player, "h") - without).mean() > 0.05
    # Pages cover the rendered image without changing it, so the same image appears again.
    assert np.abs(press(player, "Escape") - without).mean() < 1e-3
    assert player.wants_more(player.row)
    # Keys that are pressed while an image is drawn or presented are answered over this image.
    player.row.frame(player.controls(player.row))
    player.window.pressed = ["h"]
    player.observe(player.row)
    assert np.abs(player.window.image.to_numpy() - without).mean() > 0.05
    player.window.pressed = ["h"]
    assert player.wants_more(player.row)
    assert np.abs(player.window.image.to_numpy() - without).mean() < 1e-3
    press(player, "q")
    assert not player.wants_more(player.row)


def test_panels_shift_the_box_to_the_free_area(player, show):
    shifts = []
    for _ in PANELS:
        press(player, "i")
        shifts.append(show.display.camera.shift)
    assert shifts[0] == shifts[1] > 0.1 and shifts[2] == 0.0
    assert show.display.camera.state() == show.display.framing().state()
    # The centre of the box is in the middle of the free area.
    press(player, "i")
    size, box = (WIDTH, HEIGHT), np.array(show.simulation.size)
    middle = (0.5 + show.display.camera.shift) * WIDTH
    eye, direction = show.display.camera.ray(middle - 0.5, HEIGHT / 2 - 0.5, *size)
    away = box / 2 - eye
    assert np.cross(away, direction) == pytest.approx(np.zeros(3), abs=1e-9)


def test_status_shows_errors_of_bulk_density_and_volume(player, show, monkeypatch):
    frames(player, 3)
    # The water is too thin to measure its bulk density.
    assert "density" not in errors_of(show)
    monkeypatch.setattr(show, "bulk_density_error", lambda: 0.0123)
    told = errors_of(show)
    assert told.startswith("bulk density error +1.23 %")
    volume = show.display.surface.mesh.volume() / show.water_volume() - 1.0
    assert told.endswith(f"volume error {round(100.0 * volume, 1) + 0.0:+.1f} %")
    # Views of particles extract no surface, so the current volume is unknown.
    show.display.views.name = "speed"
    frames(player)
    assert "volume" not in errors_of(show)


def test_pages_are_painted_only_when_they_change(player, show, monkeypatch):
    """Regression: messages and the values of a particle were painted in every frame."""
    monkeypatch.setattr("msph.stage.layout.EVERY", math.inf)
    monkeypatch.setattr("msph.stage.layout.MESSAGE_TIME", 60.0)
    painted = []
    put = player.layout.overlay.put
    monkeypatch.setattr(player.layout.overlay, "put", lambda *a: (painted.append(a[0]), put(*a)))
    show.display.views.name = "speed"
    frames(player)
    show.display.views.neighbourhood.pick(0)
    press(player, "l", number=6)
    assert painted.count("message") == painted.count("particle") == 1


def test_graphs_show_the_measured_values(player, show):
    press(player, "i", "i")
    before = frames(player)
    for k in range(12):
        player.layout.graphs.observe(show, player.layout.graphs.times[-1] + 0.25 * k + 0.2, 1.0)
    page = player.layout.graphs.paint((200, 200), 12).pixels
    assert page.shape == (200, 200, 4) and (page[..., :3].max(-1) > 150).mean() > 0.02
    assert player.layout.overlay.shown["graphs"][0] == 0 and before.std() > 0.05
    assert len(player.layout.graphs.samples[-1][-1]) == len(show.scene.layers)


def test_sliders_change_live_parameters_and_do_not_push_the_water(player, show):
    press(player, "i")
    wanted = {
        "water": {"gravity": 3.0, "projection.viscosity": 5.0},
        "light": {"picture.tint": 9.0},
        "play": {"play.speed": 0.5, "play.scale": 0.6},
    }
    for page, values in wanted.items():
        click(player, f"page {page}")
        assert set(values) <= {w.name for w in widgets(player)}
        for key, value in values.items():
            move(player, key, value)
            assert read(show.scene, key) == pytest.approx(value, rel=1e-4)
    assert show.ledger.entries[-1].user_work == 0.0
    assert player.pacer.speed == pytest.approx(0.5) and player.pacer.finest == pytest.approx(0.6)
    viscosity = show.simulation.solver.forces[-1]
    assert viscosity.nu == pytest.approx(5.0 / 1000.0)
    assert show.display.picture.lens.numbers["absorption"][0] == pytest.approx(9.0 * 0.42)
    assert math.hypot(*show.gravity()) == pytest.approx(3.0)
    click(player, "page water")
    click(player, "reset")
    assert read(show.scene, "gravity") == pytest.approx(9.81)
    assert viscosity.nu == pytest.approx(1.0 / 1000.0)
    assert read(show.scene, "picture.tint") == pytest.approx(9.0), "of another page"


def test_the_panel_fits_the_window_and_is_painted_only_when_it_changes(player, show, monkeypatch):
    press(player, "i")
    column = player.layout.column
    before = player.window.image.to_numpy()[:column]
    with monkeypatch.context() as patched:
        patched.setattr(player.menu, "paint", lambda *_: pytest.fail("painted again"))
        frames(player)
    press(player, " ")
    move(player, "gravity", 3.0)
    after = player.window.image.to_numpy()[:column]
    assert np.abs(after - before).max() > 0.3
    # All widgets fit in a window of 960 x 540 pixels with text of 18 pixels.
    height = 540 - 2 * 9 - round(2.5 * 1.35 * 18)
    for name in PAGES:
        player.layout.page = name
        sheet = player.menu.paint((288, height), 18)
        assert max(w.bottom for w in sheet.widgets) <= height


def test_a_held_slider_does_not_present_each_image_twice(player, show, monkeypatch):
    """Regression: frames in which a slider was held were drawn and presented once more."""
    press(player, "i")
    slider = next(w for w in widgets(player) if isinstance(w, Slider))
    point(player, slider, 1.0)
    player.window.held = {"LMB"}
    press(player, "LMB")
    assert read(show.scene, slider.name) == pytest.approx(slider.hi)
    presented = []
    with monkeypatch.context() as patch:
        patch.setattr(player.window, "show", presented.append)
        assert player.wants_more(player.row) and not presented
    # Regression: a slider of a panel that was closed meanwhile took a value that is no number.
    player.layout.next_panel()
    frames(player)
    assert read(show.scene, slider.name) == pytest.approx(slider.hi)


def test_a_drag_that_begins_outside_the_panel_moves_no_slider(player, show):
    press(player, "i")
    slider = next(w for w in widgets(player) if isinstance(w, Slider))
    with player.window.holding("LMB", at=np.array([0.9, 0.9])):
        press(player, "LMB")
        point(player, slider, 1.0)
        frames(player, 2)
    assert read(show.scene, slider.name) == pytest.approx(read(show.initial, slider.name))


def test_views_scenes_and_qualities_are_chosen_in_the_panel(player, show):
    press(player, "i")
    click(player, "page views")
    click(player, "view speed")
    assert show.display.views.name == "speed"
    player.menu.set("gravity", 2.0)
    click(player, "page quality")
    click(player, "quality large")
    assert player.menu.next == Choice("pool", "large", {"gravity": pytest.approx(2.0)})
    player.menu.next = None
    click(player, "page scenes")
    click(player, "scene drop")
    assert player.menu.next == Choice("drop", "auto")


def test_keys_select_a_scene_and_the_last_selection_is_played(player, monkeypatch):
    names = list(shipped_scenes())
    press(player, *["Tab"] * 2)
    press(player, *["BackSpace"] * 3)
    here = names.index("pool") - 1
    assert player.menu.next.scene == names[here] and player.wants_more(player.row)
    monkeypatch.setattr(menu, "SETTLED", -1.0)
    assert not player.wants_more(player.row) and player.next_choice.scene == names[here]
    player.done = True
    assert player.next_choice is None, "quitting goes before"


def test_live_parameters_of_a_choice_are_applied(given, layout):
    frames(played(Row([given]), layout, choice=Choice("pool", "small", {"gravity": 4.0})))
    assert read(given.scene, "gravity") == pytest.approx(4.0)


def test_a_saved_image_has_no_pages_and_is_saved_with_its_scene(player, show, tmp_path):
    press(player, " ")
    show.set("gravity", 5.0)
    press(player, "p")
    (path,) = tmp_path.glob("pool_*.png")
    picture = imageio.imread(path)
    assert picture.shape == (HEIGHT, WIDTH, 3)
    show.draw()
    assert np.array_equal(picture, show.display.picture.to_numpy_u8())
    assert str(path) in player.layout.message
    scene = read_toml(path.with_suffix(".scene.toml"))
    assert scene["gravity"][1] == pytest.approx(-5.0)


def test_a_slice_hides_the_near_half_and_follows_the_camera(player, show):
    show.display.views.name = "speed"
    press(player, " ")
    whole = show.display.views.radius.to_numpy()[: show.simulation.particles.count]
    assert (whole > 0.0).all()
    x = show.simulation.particles.numpy("x") - 0.5 * np.array(show.simulation.size)
    press(player, "x")
    for _ in range(2):
        back = show.display.camera.axes()[2] * (1.0, 0.0, 1.0)
        near = x @ (back / np.linalg.norm(back)) > 1e-5
        hidden = show.display.views.radius.to_numpy()[: len(x)] == 0.0
        assert 0.3 < hidden.mean() < 0.7 and (hidden == near).mean() > 0.99
        show.display.camera.orbit(1.0, 0.0)
        frames(player)
    press(player, "x")
    assert (show.display.views.radius.to_numpy()[: len(x)] > 0.0).all()


def test_a_click_shorter_than_a_frame_picks_a_particle(player, show):
    """Regression: at few frames per second the window saw no button that was down."""
    show.display.views.name, about = "speed", show.display.views.neighbourhood
    player.window.at = np.array([0.5, 0.45])
    frames(player, 3)
    assert about.id is None
    player.window.pressed = ["LMB"]
    frames(player)
    assert about.id is not None


def test_a_click_on_a_particle_shows_its_neighbours_and_accelerations(player, show, monkeypatch):
    # A click counts as a click, however long the machine takes for a frame.
    monkeypatch.setattr("msph.stage.steering.CLICK_TIME", 60.0)
    show.display.views.name, about = "speed", show.display.views.neighbourhood
    frames(player, 3)
    player.window.at = np.array([0.5, 0.45])
    frames(player, 2)
    with player.window.holding("LMB"):
        press(player, "LMB", " ")
    frames(player)
    assert about.id is not None and "particle" in player.layout.overlay.shown
    # Reference weights W(r)/W(0) of the kernel M5, which vanishes at the support radius h.
    sim = show.simulation
    x, layer = sim.particles.numpy("x").astype(float), sim.particles.numpy("layer")
    specs = sim.layers.specs
    h = np.array([pair_support(specs[layer[about.index]].support, specs[k].support) for k in layer])
    q = np.linalg.norm(x - x[about.index], axis=1) / h
    found = show.display.views.value.to_numpy()[: len(x)]
    assert found == pytest.approx(quartic(q, 1.0) / quartic(0.0, 1.0), abs=1e-5)
    assert f"{(q < 1.0).sum() - 1} neighbours" in about.facts()[0]
    radius = show.display.views.radius.to_numpy()[: len(x)]
    assert radius[q > 1.001].max() < radius[q < 0.999].min()
    # The density shown is summed at the current positions, not taken from the last step.
    (told,) = re.findall(r"density ([+-][0-9.]+) %", about.facts()[1])
    sim.measure_density()
    (place,) = np.flatnonzero(sim.particles.numpy("id") == about.id)
    density = sim.particles.numpy("density")[place]
    assert float(told) == pytest.approx(100.0 * (density / 1000.0 - 1.0), abs=0.006)
    # In water at rest the acceleration by the water balances gravity.
    press(player, " ")
    frames(player, 30)
    acting = about.arrows(np.array([0.0, -9.81, 0.0]))
    assert acting["water"][1] == pytest.approx(-acting["gravity"][1], rel=0.3)
    begin, end = player.window.arrowed[0]
    assert end[1] < begin[1] and np.all((begin > 0.0) & (begin < 1.0))
    press(player, "v")
    assert about.id is None


def test_the_panel_and_its_page_stay_open_over_scenes_and_do_not_cover_messages(player, show):
    """Regression: another scene or quality closed the panel, and opening the panel covered the
    message that was shown."""
    press(player, "i")
    click(player, "page views")
    layout, row = player.layout, player.row
    again = Player(player.window, row, player.menu.choice, layout, player.menu.arguments)
    frames(again)
    assert layout.panel == "settings" and layout.page == "views"
    assert "settings" in layout.overlay.shown
    assert show.display.camera.shift == pytest.approx(0.5 * (1.0 - layout.free))
    press(again, "i", "i")
    layout.show_message("a message")
    frames(again)
    left = layout.overlay.shown["message"][0]
    press(again, "i")
    assert layout.overlay.shown["message"][0] == left + layout.column
