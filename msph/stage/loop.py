"""One loop for every audience."""

from typing import Protocol

from msph.interrupts import held_back
from msph.stage.controls import Controls
from msph.stage.show import Show


class Audience(Protocol):
    """Someone a show is given to: steers it before each frame and sees it after."""

    def wants_more(self, show: Show) -> bool: ...

    def controls(self, show: Show) -> Controls: ...

    def see(self, show: Show) -> None: ...

    def close(self) -> None: ...


def run(show: Show, audience: Audience) -> None:
    """Frames until the audience has had enough; it is closed whatever happens. Raises
    InterruptedRun after the frame in which a signal asked for it."""
    with held_back() as raise_if_asked:
        try:
            while audience.wants_more(show):
                show.frame(audience.controls(show))
                audience.see(show)
                raise_if_asked()
        finally:
            audience.close()
