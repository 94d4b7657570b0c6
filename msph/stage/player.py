"""Player: the audience at a window. Keys and mouse become controls, and pages tell what happens."""

import math
import time
from pathlib import Path

import numpy as np

from msph.measure.resolution import mean_depth
from msph.picture.camera import Camera
from msph.stage.called import Choice, SceneArguments
from msph.stage.companion import InputOverlay
from msph.stage.controls import ACTIONS, Controls
from msph.stage.idle import Idle
from msph.stage.keeper import KEEPING, Keeper
from msph.stage.keepsakes import Keepsakes
from msph.stage.layout import Layout
from msph.stage.menu import Menu
from msph.stage.pacer import Pacer
from msph.stage.replay import Replay
from msph.stage.row import Row, show_with_picked
from msph.stage.steering import BUTTONS, Steering
from msph.stage.window import Window

SLOW_MOTION = 0.1  # simulated over wall-clock time in slow motion
FORGET = 1.01  # growth per frame of the least time that showing a frame takes
ARROW = 0.3  # length of an arrow of 10 m/s^2, over the box's longest edge


class Player:
    """Plays a row in a window until it is closed or another scene is chosen; quality: what the row
    is at. layout: the window's, which outlives the player. arguments: how to load other scenes.
    frames: the largest number of frames, None for no limit. guide: that of a lesson."""

    def __init__(
        self,
        window: Window,
        row: Row,
        choice: Choice,
        quality: str,
        layout: Layout,
        arguments: SceneArguments,
        frames: int | None = None,
        guide: InputOverlay | None = None,
    ):
        self.window, self.row, self.frames, self.guide = window, row, frames, guide
        lead, play = row.lead, row.lead.scene.play
        self.layout, self.replay = layout, Replay()
        self.pacer = Pacer(play.fps, play.speed, play.scale)
        layout.begin(quality)
        self.menu = Menu(row, choice, quality, layout, self.pacer, arguments)
        self.steering = Steering(window, row)
        keepsakes = Keepsakes(Path("out"), Path(choice.scene).stem, quality)
        self.keeper = Keeper(window, layout, self.replay, keepsakes)
        sim = lead.simulation
        centre = sim.particles.numpy("x").mean(axis=0)[None]
        depth = mean_depth(lead.scene.gravity, sim.plan, centre)
        self.idle = Idle(lead.scene, depth)
        if guide:
            # The guide says what to try, and nothing moves but what the user moves.
            self.idle.tried |= set(ACTIONS.values())
            self.idle.sways = False
            layout.below, layout.taken = guide.below, guide.taken
        self.runs = guide.runs if guide else 0
        self.paused = self.done = self.helping = False
        self.clock: float | None = None  # when the last frame had been shown [s]
        self.shown = math.inf  # what showing a frame takes at least [s]: beyond, it waits

    @property
    def follows(self) -> Choice | None:
        """What was chosen to follow, unless the user has asked to quit."""
        return self.menu.next if self.window.open and not self.done else None

    # Each frame, before it.

    def wants_more(self, row: Row) -> bool:
        over = self.frames is not None and row.lead.frames >= self.frames
        return self.window.open and not (self.done or over or self.menu.settled)

    def controls(self, row: Row) -> Controls:
        controls, steering, guide = Controls(), self.steering, self.guide
        pressed = self.window.presses()
        steering.look()
        for key in pressed:
            if key in BUTTONS:
                steering.free[key] = not self._covered()
            elif guide and guide.takes(key):
                self._follow(guide)
            elif key in ACTIONS:
                self._press(ACTIONS[key], controls)
        self.pacer.steer(controls)
        step, wall = self.pacer.frame_time, self.pacer.wall
        # While a lesson waits, keys do nothing.
        waits = guide is not None and guide.waits
        held = not waits and steering.hold(step, wall, self.paused)
        dragged = self._drag(controls, step)
        self.idle.pass_time(wall, bool(pressed or held or dragged or steering.moved.any()))
        sway = self.idle.roll(row.lead.simulation.time, 0.0 if self._still else step)
        controls.tilt = (float(steering.tilt[0]) + sway, float(steering.tilt[1]))
        controls.paused = self._still
        return controls

    @property
    def _still(self) -> bool:
        """True while the simulation is paused, by the user or by the guide."""
        return self.paused or (self.guide is not None and self.guide.waits)

    def _follow(self, guide: InputOverlay) -> None:
        """Levels the pool where the guide has reset the simulation."""
        if guide.runs != self.runs:
            self.runs = guide.runs
            self.steering.tilt[:] = 0.0

    def _covered(self) -> bool:
        """True if the cursor is over a page, and not over the water."""
        cursor = self.steering.cursor
        return (self.guide is not None and self.guide.covers(cursor)) or self.layout.covers(cursor)

    def _drag(self, controls: Controls, step: float) -> bool:
        """What the mouse does; whether a button is down beside the pages."""
        steering, down = self.steering, self.window.down("LMB")
        self.idle.tried.add(steering.turn())
        if self.guide and self.guide.drag(steering.cursor, down):
            return True
        self.menu.touch(steering.cursor, down)
        if steering.clicked() and self.row.lead.views.name != "water":
            steering.pick()
        held = steering.held()
        if held[0]:
            self.idle.tried.add("push")
        steering.push(controls, step, self._covered())
        return any(held)

    def _press(self, action: str, controls: Controls) -> None:
        """What a key asks for at once; others act as long as they are down."""
        self.idle.tried.add(action)
        if action == "quit" and self.helping:
            action = "help"
        act = getattr(self, f"_{action}", None)
        if action in ("reset", "next_view"):
            setattr(controls, action, True)
        elif action == "step":
            controls.single_step = True
        elif action in KEEPING:
            getattr(self.keeper, action)(self.row)
            self.clock = None
        elif act:
            act()
        if action == "reset":
            self.steering.tilt[:] = 0.0

    def _pause(self) -> None:
        self.paused = not self.paused

    def _slow_motion(self) -> None:
        usual = self.row.lead.scene.play.speed
        self.pacer.set_speed(SLOW_MOTION * usual if self.pacer.speed == usual else usual)

    def _lock(self) -> None:
        locked = self.steering.locked = not self.steering.locked
        self.layout.show_message(
            "the tilt is locked" if locked else "the pool comes level by itself"
        )

    def _framing(self) -> Camera:
        """The scene's view beside the column."""
        lead = self.row.lead
        return lead.framing(1.0 if self.row.composed else self.layout.free, lead.camera.stretch)

    def _home(self) -> None:
        self.row.lead.camera = self._framing()
        self.steering.tilt[:] = 0.0

    def _help(self) -> None:
        self.helping = not self.helping
        self.layout.show_help(self.helping)

    def _next_panel(self) -> None:
        before, camera = self._framing().distance, self.row.lead.camera
        self.layout.next_panel()
        self.menu.panel.painted = None
        framing = self._framing()
        camera.shift = framing.shift
        camera.zoom(framing.distance / before)

    def _next_scene(self) -> None:
        self.menu.step(1)

    def _previous_scene(self) -> None:
        self.menu.step(-1)

    def _quit(self) -> None:
        self.done = True

    def _slice(self) -> None:
        self.row.slice()
        if self.row.lead.views.cut is not None and self.row.lead.views.name == "water":
            self.layout.show_message("the slice is seen in views of particles: v")

    # Each frame, after it.

    def observe(self, row: Row) -> None:
        now, image = time.perf_counter(), row.image
        if not self._still:
            self.replay.observe(row, now)
        if self.guide:
            self.guide.look()
        self.menu.lay()
        if self.guide:
            self.guide.lay(image)
        if not (self.guide and self.guide.whole):
            self.layout.lay(row, self.pacer, self._still, self.idle)
        if self.steering.hand.pushes:
            self.window.mark(self.steering.cursor)
        self._draw_arrows()
        begin = time.perf_counter()
        self.window.show(image)
        now = time.perf_counter()
        self.shown = min(FORGET * self.shown, now - begin)
        if self.clock is not None and not self._still:
            self.pacer.observe(row, now - self.clock, self.shown)
        self.clock = now

    def _draw_arrows(self) -> None:
        """What acts on the particle that was picked."""
        of = show_with_picked(self.row)
        # They lie over every page.
        if of is None or self.helping or self.layout.panel:
            return
        about, sim = of.views.neighbourhood, of.simulation
        gravity = of.tilt.T @ np.array(of.scene.gravity)
        place, length = about.place(), ARROW / 10.0 * max(sim.size)
        ends = [(place, place + length * a) for a in about.arrows(gravity).values()]
        if ends:
            flat = np.array(ends).reshape(-1, 3)
            size = of.picture.width, of.picture.height
            places = self.row.to_window(of, of.camera.seen(flat, *size, sim.size, of.tilt))
            self.window.arrows(places.reshape(-1, 2, 2))

    def close(self) -> None:
        """The window stays open: another scene may follow."""
