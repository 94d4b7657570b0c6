"""The person at the window: keys and mouse become controls, and pages tell what happens."""

import math
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from msph.measure.resolution import mean_depth
from msph.picture.camera import Camera
from msph.scene.errors import SceneError
from msph.scene.library import shipped_scenes
from msph.scene.live import live_parameters, read
from msph.scene.load import load_scene
from msph.scene.quality import AUTO, at_quality
from msph.stage.choice import Choice, WatersOf
from msph.stage.companion import Companion
from msph.stage.controls import ACTIONS, Controls
from msph.stage.idle import Idle
from msph.stage.keeper import KEEPING, Keeper
from msph.stage.keepsakes import Keepsakes
from msph.stage.layout import Layout
from msph.stage.pacer import Pacer
from msph.stage.panel import Panel, Wish
from msph.stage.pushing import PushingHand
from msph.stage.replay import Replay
from msph.stage.row import Waters, with_picked
from msph.stage.window import Window

ORBIT_PER_WIDTH = math.radians(200.0)  # a drag across the whole window turns the view so far
ORBIT_KEY_RATE = math.radians(70.0)  # [rad/s]
ZOOM_KEY_RATE = 1.5  # [1/s], as the logarithm of the distance
SLOW_MOTION = 0.1  # simulated over wall-clock time in slow motion
LEVELLING = 0.5  # rate at which a pool comes level over that of tilting it
FORGET = 1.01  # growth per frame of the least time that showing a frame takes
CLICK_WAY, CLICK_TIME = 0.01, 0.4  # most way (shares of the window) and time [s] of a click
ARROW = 0.3  # length of an arrow of 10 m/s^2, over the box's longest edge
BUTTONS = ("LMB", "RMB", "MMB")


class Player:
    """Plays a choice in a window until it is closed; quality: what it is at. frames limits the
    number of frames, None: until then. follow: is told of a choice that is to follow, `next`;
    waters_of: what there is of its scene. guide: whom a lesson sends along."""

    def __init__(
        self,
        window: Window,
        show: Waters,
        choice: Choice,
        quality: str,
        frames: int | None = None,
        follow: Callable[[Choice], None] = lambda choice: None,
        waters_of: WatersOf = lambda name: {name: load_scene(name)},
        guide: Companion | None = None,
    ):
        self.guide, self.follow, self.waters_of = guide, follow, waters_of
        # Of each water the live parameters as its scene says.
        self.given = [
            {live.key: read(each.scene, live.key) for live in live_parameters(each.scene)}
            for each in show.shows
        ]
        self.window, self.choice, self.quality, self.frames = window, choice, quality, frames
        self.next: Choice | None = None
        self.notice = ""  # what the window has told last
        play = show.scene.play
        self.pacer = Pacer(play.fps, play.speed, play.scale)
        self.layout = Layout(window.size, quality)
        self.panel = Panel(show.lead, choice.scene, quality)
        self.replay = Replay()
        keepsakes = Keepsakes(Path("out"), Path(choice.scene).stem, quality)
        self.keeper = Keeper(window, self.layout, self.replay, keepsakes)
        lead = show.lead
        depth = mean_depth(lead.scene, lead.simulation.particles.numpy("x").mean(axis=0)[None])
        self.idle = Idle(show.scene, depth)
        if guide:
            # It says what to try, and nothing moves but what somebody moves.
            self.idle.tried |= set(ACTIONS.values())
            self.idle.sways = False
            self.layout.below, self.layout.taken = guide.below, guide.taken
        self.hand = PushingHand()
        self.runs = guide.runs if guide else 0
        self.tilt: Any = np.zeros(2)  # roll, pitch [rad]
        self.locked = not play.level
        self.paused = self.done = self.helping = False
        self.cursor = window.cursor()
        self.down: Any = None  # where the left button went down, and when [s]
        self.free: dict[str, bool] = {}  # whether a button went down beside the panel
        self.clock: float | None = None  # when the last frame had been shown [s]
        self.shown = math.inf  # what showing a frame takes at least [s]: beyond, it waits
        for key, value in choice.set.items():
            self._set(show, key, value)

    # Each frame, before it.

    def wants_more(self, show: Waters) -> bool:
        over = self.frames is not None and show.frames >= self.frames
        return self.window.open and not self.done and not over

    def controls(self, show: Waters) -> Controls:
        wishes, pressed = Controls(), self.window.presses()
        cursor = self.window.cursor()
        moved, self.cursor = cursor - self.cursor, cursor
        for key in pressed:
            if key in BUTTONS:
                self.free[key] = not self._covered()
            elif self.guide and self.guide.takes(key):
                self._follow(self.guide)
            elif key in ACTIONS:
                self._press(ACTIONS[key], show, wishes)
        # A window that was resized shows the same pixels in another shape.
        show.camera.stretch = self.window.aspect * self.window.size[1] / self.window.size[0]
        self.pacer.steer(wishes)
        step = self.pacer.frame_time
        held = self._hold(show, step)
        dragged = self._drag(show, moved, wishes, step)
        self.idle.pass_time(self.pacer.wall, bool(pressed or held or dragged or moved.any()))
        sway = self.idle.roll(show.lead.simulation.time, 0.0 if self._still else step)
        wishes.tilt = (float(self.tilt[0]) + sway, float(self.tilt[1]))
        wishes.paused = self._still
        return wishes

    @property
    def _still(self) -> bool:
        """Whether the water waits, for the player or for the guide."""
        return self.paused or (self.guide is not None and self.guide.waits)

    def _follow(self, guide: Companion) -> None:
        """Levels the pool where the guide has let the water begin anew."""
        if guide.runs != self.runs:
            self.runs = guide.runs
            self.tilt[:] = 0.0

    def _covered(self) -> bool:
        """Whether the cursor is over a page, and not over the water."""
        guided = self.guide is not None and self.guide.covers(self.cursor)
        return guided or self.layout.covers(self.cursor)

    def _press(self, action: str, show: Waters, wishes: Controls) -> None:
        """What a key asks for at once; others act as long as they are down."""
        self.idle.tried.add(action)
        if action == "quit" and self.helping:
            action = "help"
        act = getattr(self, f"_{action}", None)
        if action in ("reset", "next_view"):
            setattr(wishes, action, True)
        elif action == "step":
            wishes.single_step = True
        elif action in KEEPING:
            getattr(self.keeper, action)(show)
            self.clock = None
        elif act:
            act(show)
        if action == "reset":
            self.tilt[:] = 0.0

    def _pause(self, show: Waters) -> None:
        self.paused = not self.paused

    def _slow_motion(self, show: Waters) -> None:
        usual = show.scene.play.speed
        self.pacer.ask(SLOW_MOTION * usual if self.pacer.speed == usual else usual)

    def _lock(self, show: Waters) -> None:
        self.locked = not self.locked
        self.layout.say("the tilt is locked" if self.locked else "the pool comes level by itself")

    def _framing(self, show: Waters) -> Camera:
        """The scene's view beside the column."""
        free = self.layout.free if show is show.lead else 1.0
        return show.lead.framing(free, show.camera.stretch)

    def _home(self, show: Waters) -> None:
        show.lead.camera = self._framing(show)
        self.tilt[:] = 0.0

    def _help(self, show: Waters) -> None:
        self.helping = not self.helping
        self.layout.show_help(self.helping)

    def _next_panel(self, show: Waters) -> None:
        before = self._framing(show).distance
        self.layout.next_panel()
        self.panel.painted = None
        framing = self._framing(show)
        show.camera.shift = framing.shift
        show.camera.zoom(framing.distance / before)

    def _next_scene(self, show: Waters) -> None:
        self._beside(1)

    def _previous_scene(self, show: Waters) -> None:
        self._beside(-1)

    def _beside(self, step: int) -> None:
        names, last = list(shipped_scenes()), (self.next or self.choice).scene
        here = names.index(last) if last in names else -max(step, 0)
        self._leave(Choice(names[(here + step) % len(names)], self.choice.quality))

    def _leave(self, choice: Choice) -> None:
        """For another scene or quality, if it can be loaded."""
        try:
            for scene in self.waters_of(choice.scene).values():
                if choice.quality != AUTO:
                    at_quality(scene, choice.quality, choice.scene)
        except SceneError as error:
            self.layout.say(str(error))
        else:
            self.next = choice
            self.follow(choice)

    def _quit(self, show: Waters) -> None:
        self.done = True

    def _hold(self, show: Waters, step: float) -> bool:
        """Keys that act as long as they are down; whether any is. While a lesson waits, none."""
        if self.guide and self.guide.waits:
            return False
        down, play, wall = self.window.down, show.scene.play, self.pacer.wall
        rate, limit = math.radians(play.tilt_rate) * step, math.radians(play.tilt_limit)
        asked = np.array([down("Left") - down("Right"), down("Down") - down("Up")], float)
        back = LEVELLING * rate * (asked == 0.0) * (not self.locked and not self.paused)
        self.tilt -= np.clip(self.tilt, -back, back)
        self.tilt = np.clip(self.tilt + rate * asked, -limit, limit)
        orbit, zoom = down("d") - down("a"), down("s") - down("w")
        show.camera.orbit(ORBIT_KEY_RATE * wall * orbit, 0.0)
        show.camera.zoom(math.exp(ZOOM_KEY_RATE * wall * zoom))
        return bool(asked.any() or orbit or zoom)

    def _drag(self, show: Waters, moved: np.ndarray, wishes: Controls, step: float) -> bool:
        """What the mouse does beside the panel; whether a button is down there."""
        on_page = self._covered()
        left, right, middle = (self.window.down(b) and self.free.get(b, True) for b in BUTTONS)
        if middle or (right and self.window.down("Shift")):
            self.idle.tried.add("pan")
            across = 2.0 * math.tan(0.5 * show.camera.fov) * show.camera.distance
            show.camera.pan(-moved[0] * across * self.window.aspect, -moved[1] * across)
        elif right:
            self.idle.tried.add("orbit")
            show.camera.orbit(-moved[0] * ORBIT_PER_WIDTH, -moved[1] * ORBIT_PER_WIDTH)
        if self.guide and self.guide.drag(self.cursor, self.window.down("LMB")):
            return True
        self._touch_panel(show)
        self._click(show, bool(left))
        if left:
            self.idle.tried.add("push")
            wishes.hand = self.hand.push(show, self.cursor, step)
        elif show.scene.play.hover and moved.any() and not (right or middle or on_page):
            wishes.hand = self.hand.pass_over(show, self.cursor, step)
        else:
            wishes.hand = self.hand.let_go()
        return bool(left or right or middle)

    def _touch_panel(self, show: Waters) -> None:
        """What the left button asks for on the panel, if it is open."""
        if self.layout.panel != "settings":
            return
        x, y = self.layout.on_column(self.cursor)
        for wish in self.panel.touch(x, y, self.window.down("LMB"), show.lead):
            self._grant(show, wish)

    def _click(self, show: Waters, left: bool) -> None:
        """A button that goes up where it went down, and soon, has clicked."""
        now = time.perf_counter()
        if left and self.down is None:
            self.down = self.cursor, now
        elif not left and self.down is not None:
            place, since = self.down
            self.down = None
            still = np.abs(self.cursor - place).max() < CLICK_WAY
            if still and now - since < CLICK_TIME and show.lead.views.name != "water":
                self._pick(show)

    def _pick(self, show: Waters) -> None:
        """The particle under the cursor, of whichever water."""
        under, place = show.under(self.cursor)
        i, j = (int(v) for v in place * (under.picture.width, under.picture.height))
        found = under.particle_at(i, j)
        for other in show.shows:
            picked = None if found is None or other is not under else found[0]
            other.views.neighbourhood.pick(picked)

    def _slice(self, show: Waters) -> None:
        show.slice()
        if show.lead.views.cut is not None and show.lead.views.name == "water":
            self.layout.say("the slice is seen in views of particles: v")

    # Each frame, after it.

    def see(self, show: Waters) -> None:
        now = time.perf_counter()
        if not self._still:
            self.replay.see(show, now)
        if self.window.notice() != self.notice:
            self.notice = self.window.notice()
            self.layout.say(self.notice)
        if self.guide:
            self.guide.look()
        if self.layout.panel == "settings":
            size, text = self.layout.column_size, self.layout.text
            self.layout.lay_panel(self.panel.paint(show.lead, size, text))
        if self.guide:
            self.guide.lay(show.picture.image)
        if not (self.guide and self.guide.whole):
            self.layout.lay(show, self.pacer, self._still, self.idle)
        if self.hand.pushes:
            self.window.mark(self.cursor)
        self._draw_arrows(show)
        begin = time.perf_counter()
        self.window.show(show.picture.image)
        now = time.perf_counter()
        self.shown = min(FORGET * self.shown, now - begin)
        if self.clock is not None and not self._still:
            self.pacer.see(show, now - self.clock, self.shown)
        self.clock = now

    def _draw_arrows(self, show: Waters) -> None:
        """What acts on the particle that was picked."""
        of = with_picked(show)
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
            places = show.placed(of, of.camera.seen(flat, *size, sim.size, of.tilt))
            self.window.arrows(places.reshape(-1, 2, 2))

    def _grant(self, show: Waters, wish: Wish) -> None:
        if wish.kind == "set":
            self._set(show, wish.name, wish.value)
        elif wish.kind == "reset":
            for each, given in zip(show.shows, self.given, strict=True):
                if wish.name in given:
                    each.set(wish.name, given[wish.name])
            self._pace(wish.name, read(show.lead.scene, wish.name))
        elif wish.kind == "view":
            show.lead.views.name = wish.name
        elif wish.kind == "scene":
            self._leave(Choice(wish.name, self.choice.quality))
        elif wish.kind == "quality":
            changed = {
                live.key: value
                for live in self.panel.live
                if (value := self.panel.value(show.lead, live.key)) != self.panel.given[live.key]
            }
            self._leave(Choice(self.choice.scene, wish.name, changed))

    def _set(self, show: Waters, key: str, value: float) -> None:
        show.set(key, value)
        self._pace(key, value)

    def _pace(self, key: str, value: float) -> None:
        """Tells the pacer of a parameter that is its own."""
        if key == "play.speed":
            self.pacer.ask(value)
        if key == "play.scale":
            self.pacer.finest = value

    def close(self) -> None:
        """The window stays open: another water may follow."""
