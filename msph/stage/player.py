"""Player: runs simulations in a window, turns keys and mouse into controls, draws the pages."""

import math
import time
from functools import partial
from pathlib import Path

import numpy as np

from msph.fluid.methods import METHODS
from msph.measure.resolution import mean_depth
from msph.picture.camera import Camera
from msph.stage.autosave import forget, offer
from msph.stage.choice import Choice, SceneArguments
from msph.stage.controls import Controls
from msph.stage.ggui_window import Window
from msph.stage.idle import Idle
from msph.stage.input_overlay import InputOverlay
from msph.stage.keepsakes import SAVING, Saver
from msph.stage.keys import ACTIONS
from msph.stage.layout import Layout
from msph.stage.loop import Audience
from msph.stage.menu import Menu
from msph.stage.pacer import Pacer
from msph.stage.pages import toolbar
from msph.stage.row import Row, show_with_picked
from msph.stage.steering import Steering
from msph.stage.tools import BY_NAME, Tool, next_tool
from msph.stage.window import BUTTONS

SLOW_MOTION = 0.1  # simulated over wall-clock time in slow motion
PRESENT_GROWTH = 1.01  # growth per frame of the estimated time to present a frame
ARROW = 0.3  # length of an arrow for 10 m/s^2 over the box's longest edge


class Player(Audience):
    """Runs a row in a window until the window is closed or another scene is chosen. layout: shared
    by the players of a session; guide: overlay of a lesson."""

    def __init__(
        self,
        window: Window,
        row: Row,
        choice: Choice,
        layout: Layout,
        arguments: SceneArguments,
        guide: InputOverlay | None = None,
    ):
        self.window, self.row, self.guide = window, row, guide or InputOverlay()
        self.has_toolbar = guide is None
        lead, play = row.lead, row.lead.scene.play
        self.layout = layout
        self.pacer = Pacer(play.fps, play.speed, play.scale)
        layout.begin(choice.quality_now)
        self.menu = Menu(row, choice, layout, self.pacer, arguments)
        self.steering = Steering(window, row)
        row.between = self._answer_input
        self.saver = Saver(layout, Path(choice.scene).stem, choice.quality_now)
        plan = lead.state.plan
        depth = mean_depth(lead.scene.gravity, plan, plan.initial["x"].mean(axis=0)[None])
        self.idle = Idle(lead.scene, depth)
        if guide:
            # A lesson gives its own hints, and only the user moves the pool.
            self.idle.tried |= set(ACTIONS.values())
            self.idle.sways = False
            layout.below, layout.taken, layout.panel = guide.below, guide.taken, ""
        elif layout.panel:
            lead.display.camera = self._framing()
        self.runs = self.guide.runs
        self.lost: Choice | None = None  # a lost session that is offered to the user
        self.paused = self.single_step = self.done = self.helping = False
        self.pressed = list[str]()  # keys and buttons since the last controls()
        self.slides = False  # True while a slider of the lesson is held
        self.clock: float | None = None  # time at which the last frame was presented [s]
        self.present = math.inf  # time to present a frame, without the wait for the display [s]

    @property
    def next_choice(self) -> Choice | None:
        """The scene to play next, None after a request to quit."""
        return self.menu.next if self.window.open and not self.done else None

    def wants_more(self, row: Row) -> bool:
        # Input that arrived while the last image was presented is answered before the next one.
        self._answer_input()
        row.receive()
        return self.window.open and not (self.done or self.menu.settled)

    def controls(self, row: Row) -> Controls:
        self._read_input()
        controls, steering = Controls(), self.steering
        self.pacer.steer(controls)
        step, wall = self.pacer.frame_time, self.pacer.wall
        # While a lesson pauses the simulation, held keys do nothing.
        controls.still = self._paused and not self.single_step
        held = not self.guide.pauses and steering.apply_keys(step, wall, self.paused)
        dragged = self._drag(controls, step)
        self.idle.pass_time(wall, bool(self.pressed or held or dragged or steering.moved.any()))
        sway = self.idle.roll(row.lead.now.time, 0.0 if self._paused else step)
        controls.tilt = (float(steering.tilt[0]) + steering.jolt + sway, float(steering.tilt[1]))
        controls.azimuth = row.lead.display.camera.azimuth
        # While the simulation has not answered, a step waits.
        self.single_step = self.single_step and row.busy
        self.pressed, steering.moved = [], np.zeros(2)
        return controls

    def _answer_input(self) -> None:
        """Acts on new input, and shows what it changed on pages over the last image."""
        if self._read_input():
            self.row.restore()
            self._present(self.row)

    def _read_input(self) -> bool:
        """Acts on keys pressed since the last call, and on the mouse over pages; returns True if a
        key was pressed, or a button on a page. It is called after each slow part of a frame, so
        that pages answer soon."""
        steering, guide, pressed = self.steering, self.guide, self.window.presses()
        steering.read_cursor()
        mouse = steering.cursor, self.window.down("LMB"), "LMB" in pressed
        self.slides = guide.drag(*mouse)
        for key in pressed:
            if key in BUTTONS:
                steering.press(key, not (self.slides or self._on_page()))
            elif self.lost and ACTIONS.get(key) not in (None, "quit"):
                self._answer(key)
            elif guide.handle_key(key):
                self._level_after_reset()
            elif key in ACTIONS:
                self._press(ACTIONS[key])
        self.pressed += pressed
        if not self.slides:
            self.menu.touch(*mouse)
            if chosen := self.layout.pages["tools"].act(*mouse):
                self._choose_tool(BY_NAME[chosen[0]])
        return any(key not in BUTTONS or self._on_page() for key in pressed)

    @property
    def _paused(self) -> bool:
        """True while the simulation is paused, by the user or the lesson."""
        return self.paused or self.guide.pauses

    def _level_after_reset(self) -> None:
        """Levels the pool after a reset by the lesson."""
        if self.guide.runs != self.runs:
            self.runs = self.guide.runs
            self.steering.stop()

    def _on_page(self) -> bool:
        """Returns True if the cursor is on a page."""
        cursor = self.steering.cursor
        return self.guide.is_on_page(cursor) or self.layout.is_on_page(cursor)

    def _drag(self, controls: Controls, step: float) -> bool:
        """Handles the mouse outside pages; returns True while a button is used."""
        steering = self.steering
        self.idle.tried.add(steering.drag_camera())
        if self.slides:
            return True
        clicked = steering.clicked("LMB" in self.pressed)
        if clicked and self.row.lead.display.views.name != "water":
            steering.pick()
        held = steering.held_buttons()
        if held[0]:
            self.idle.tried.add("push")
        controls.use = steering.use_tool(controls.still, step, self._on_page())
        return any(held)

    def _answer(self, key: str) -> None:
        """Continues the offered session, or deletes all sessions that ended by a crash."""
        if key == "Return":
            self.menu.next = self.lost
        else:
            forget()
            self.layout.show_message("the saved session was deleted")
        self.lost = None

    def _press(self, action: str) -> None:
        """Carries out an action that happens once per key press."""
        self.idle.tried.add(action)
        if action == "quit" and self.helping:
            action = "help"
        act = getattr(self, f"_{action}", None)
        if action == "next_view":
            self.row.lead.display.views.next()
        elif action == "reset":
            self.row.reset()
            self.steering.stop()
        elif action == "single_step":
            self.single_step = True
        elif action in SAVING:
            self.saver.act(action, self.row)
            self.clock = None
        elif action == "pause":
            self.paused = not self.paused
        elif action in ("next_scene", "previous_scene"):
            self.menu.step(1 if action == "next_scene" else -1)
        elif action == "quit":
            self.done = True
        elif action.startswith("tool "):
            self._choose_tool(next_tool(action.removeprefix("tool "), self.steering.tool))
        elif act:
            act()

    def _choose_tool(self, tool: Tool) -> None:
        self.steering.tool = tool
        self.steering.contact.let_go()
        self.layout.show_message(tool.effect)
        for show in self.row.shows:
            if tool.bodies and METHODS[show.scene.method].HAS_BODIES:
                show.later.append(show.display.draw_as_with_bodies)

    def _jolt(self) -> None:
        self.steering.jolted = 0.0
        self.layout.show_message("jolt: the pool rocks for a second")

    def _slow_motion(self) -> None:
        normal = self.row.lead.scene.play.speed
        self.pacer.set_speed(SLOW_MOTION * normal if self.pacer.speed == normal else normal)

    def _lock(self) -> None:
        locked = self.steering.locked = not self.steering.locked
        self.layout.show_message(
            "the tilt is locked" if locked else "the pool comes level by itself"
        )

    def _framing(self) -> Camera:
        """Returns the scene's camera, centred in the area right of the panel."""
        lead = self.row.lead
        return lead.display.framing(
            1.0 if self.row.composed else self.layout.free, lead.display.camera.stretch
        )

    def _home(self) -> None:
        self.row.lead.display.camera = self._framing()
        self.steering.levels = True

    def _help(self) -> None:
        self.helping = not self.helping
        self.layout.show_help(self.helping)

    def _next_panel(self) -> None:
        before, camera = self._framing().distance, self.row.lead.display.camera
        self.layout.next_panel()
        framing = self._framing()
        camera.shift = framing.shift
        camera.zoom(framing.distance / before)

    def _slice(self) -> None:
        for show in self.row.shows:
            show.display.slice()
        if (
            self.row.lead.display.views.cut is not None
            and self.row.lead.display.views.name == "water"
        ):
            self.layout.show_message("the slice is visible in the particle views: press v")

    def observe(self, row: Row) -> None:
        if not self._paused:
            self.saver.clip.observe(row.image, time.perf_counter())
        self._read_input()
        self._present(row)
        if not row.lead.new:
            return
        now = time.perf_counter()
        if self.clock is not None and not self._paused:
            self.pacer.observe(row, now - self.clock, self.present)
        self.clock = now

    def _present(self, row: Row) -> None:
        """Draws the pages over the image, and shows it."""
        self.saver.report()
        if self.lost and self.layout.idle:
            self.layout.show_message(offer(self.lost))
        for show in row.shows:
            if show.note:
                self.layout.show_message(show.note)
                show.note = ""
        self.guide.update()
        self.menu.draw()
        self.guide.draw(row.image)
        if self.has_toolbar:
            tool, layout = self.steering.tool, self.layout
            at = self.window.size[0] - layout.gap, layout.gap
            paint = partial(toolbar, tool, layout.text)
            layout.pages["tools"].show(tool.name, paint, at, (1.0, 0.0))
        if not self.guide.is_full_page:
            self.layout.draw(row, self.pacer, self._paused, self.idle)
        if self.steering.contact.holds:
            self.window.mark(self.steering.cursor)
        self._draw_arrows()
        begin = time.perf_counter()
        self.window.show(row.image)
        self.present = min(PRESENT_GROWTH * self.present, time.perf_counter() - begin)

    def close(self) -> None:
        self.saver.close()

    def _draw_arrows(self) -> None:
        """Draws the accelerations of the picked particle."""
        show = show_with_picked(self.row)
        # Arrows would cover the pages.
        if show is None or self.helping or self.layout.panel:
            return
        picked, size = show.display.views.neighbourhood, show.scene.box.size
        gravity = show.now.tilt.T @ np.array(show.scene.gravity)
        place, length = picked.place(), ARROW / 10.0 * max(size)
        ends = [(place, place + length * a) for a in picked.arrows(gravity).values()]
        if ends:
            flat = np.array(ends).reshape(-1, 3)
            places = show.display.view.project(
                flat, *show.display.picture.size, size, show.now.tilt
            )
            places = self.row.to_window(show, places)
            self.window.arrows(places.reshape(-1, 2, 2))
