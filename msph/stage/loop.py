"""One loop for every audience."""

from typing import Protocol, TypeVar

from msph.interrupts import held_back
from msph.stage.controls import Controls
from msph.stage.row import Row
from msph.stage.show import Show

# What is shown: one water, or several side by side.
Shown = TypeVar("Shown", bound=Show | Row, contravariant=True)


class Audience(Protocol[Shown]):
    """Someone a show is given to: steers it before each frame and sees it after."""

    def wants_more(self, show: Shown) -> bool: ...

    def controls(self, show: Shown) -> Controls: ...

    def see(self, show: Shown) -> None: ...

    def close(self) -> None: ...


def run(show: Shown, audience: Audience[Shown]) -> None:
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
