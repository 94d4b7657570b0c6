"""Water that nobody touches: after a while its pool sways, and a line says what to try."""

import math

from msph.scene.schema import Scene
from msph.stage.controls import KEYS

# Time without anybody [s] until then; time [s] in which the sway grows and fades.
IDLE_DELAY, RAMP_TIME = 3.0, 2.0
# Largest tilt [rad], and period of the sway over that of the pool's first mode (-): at resonance
# the waves would grow until they break.
MAX_TILT, PERIOD_RATIO = math.radians(2.5), 1.4


class Idle:
    """depth [m] of the scene's water: with the box's width it tells how slowly the pool sways."""

    def __init__(self, scene: Scene, depth: float):
        self.sways = scene.play.idle
        self.until = scene.sway.seconds if scene.sway.angle else 0.0  # sways by itself [s]
        wave = math.pi / scene.box.size[0]
        gravity = max(math.hypot(*scene.gravity), 1.0)
        self.rate = math.sqrt(gravity * wave * math.tanh(wave * max(depth, 1e-3))) / PERIOD_RATIO
        self.strength, self.phase, self.idle_time = 0.0, 0.0, 0.0
        self.tried: set[str] = set()

    def pass_time(self, wall: float, busy: bool) -> None:
        """Takes in a frame of `wall` [s] in which somebody was busy, or not."""
        self.idle_time = 0.0 if busy else self.idle_time + wall
        grows = self.sways and self.idle_time > IDLE_DELAY
        step = wall / RAMP_TIME * (1.0 if grows else -1.0)
        self.strength = min(max(self.strength + step, 0.0), 1.0)

    def roll(self, time: float, step: float) -> float:
        """Tilt [rad] about the view's axis in a frame of `step` [s] that begins at `time` [s]."""
        if not self.strength or time < self.until:
            return 0.0
        self.phase += self.rate * step
        return MAX_TILT * self.strength * math.sin(self.phase)

    def hint(self) -> str:
        """What somebody who does nothing may try."""
        if self.idle_time < IDLE_DELAY:
            return ""
        return next((k.hint for k in self.hints()), "")

    def hints(self) -> list:
        """Keys with a hint that nobody has used."""
        return [k for k in KEYS if k.hint and not self.tried & set(k.keys.values())]
