"""Idle behaviour of a window: after a while without input the pool sways and a hint is shown."""

import math

from msph.scene.schema import Scene
from msph.stage.keys import KEYS, Key

# Time without input before the sway starts [s]; time in which the sway grows and fades [s].
IDLE_DELAY, RAMP_TIME = 3.0, 2.0
# Amplitude of the sway [rad], and its period over that of the pool's first mode (-): at resonance
# the waves would grow until they break.
MAX_TILT, PERIOD_RATIO = math.radians(2.5), 1.4


class Idle:
    """Sway and hints of an idle window. depth [m]: mean water depth, which with the box's width
    gives the period of the pool's first mode."""

    def __init__(self, scene: Scene, depth: float):
        self.sways = scene.play.idle
        # End of the sway that the scene itself prescribes [s].
        self.until = scene.sway.seconds if scene.sway.angle else 0.0
        wave = math.pi / scene.box.size[0]
        gravity = max(math.hypot(*scene.gravity), 1.0)
        self.rate = math.sqrt(gravity * wave * math.tanh(wave * max(depth, 1e-3))) / PERIOD_RATIO
        self.strength, self.phase, self.idle_time = 0.0, 0.0, 0.0
        self.tried: set[str] = set()

    def pass_time(self, wall: float, busy: bool) -> None:
        """Accounts for a frame of `wall` [s], with input if `busy`."""
        self.idle_time = 0.0 if busy else self.idle_time + wall
        grows = self.sways and self.idle_time > IDLE_DELAY
        step = wall / RAMP_TIME * (1.0 if grows else -1.0)
        self.strength = min(max(self.strength + step, 0.0), 1.0)

    def roll(self, time: float, step: float) -> float:
        """Returns the tilt [rad] about the view axis for a frame of `step` [s] from `time` [s]."""
        if not self.strength or time < self.until:
            return 0.0
        self.phase += self.rate * step
        return MAX_TILT * self.strength * math.sin(self.phase)

    def hint(self) -> str:
        """Returns the hint for an idle user, "" while the user is active or has tried all hints."""
        if self.idle_time < IDLE_DELAY:
            return ""
        return next((k.hint for k in self.hints()), "")

    def hints(self) -> list[Key]:
        """Returns the keys with a hint that have not been used yet."""
        return [k for k in KEYS if k.hint and not self.tried & set(k.keys.values())]
