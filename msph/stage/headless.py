"""The audience that sees nothing: the benchmark."""

from msph.stage.controls import Controls
from msph.stage.show import Show


class Headless:
    """Wants `frames` frames and touches nothing."""

    def __init__(self, frames: int):
        self.frames = frames
        self.done = 0

    def wants_more(self, show: Show) -> bool:
        return self.done < self.frames

    def controls(self, show: Show) -> Controls:
        return Controls()

    def see(self, show: Show) -> None:
        self.done += 1

    def close(self) -> None:
        pass
