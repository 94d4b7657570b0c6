"""One loop for every audience."""

from typing import Protocol

from msph.interrupts import deferred_signals
from msph.stage.controls import Controls
from msph.stage.row import Row


class Audience(Protocol):
    """Steers a row of simulations before each frame, and sees it after."""

    def wants_more(self, row: Row) -> bool: ...

    def controls(self, row: Row) -> Controls: ...

    def observe(self, row: Row) -> None: ...

    def close(self) -> None: ...


def run(row: Row, audience: Audience) -> None:
    """Frames until the audience has had enough; it is closed whatever happens. Raises
    InterruptedRun after the frame in which a signal asked for it."""
    with deferred_signals() as raise_if_signalled:
        try:
            while audience.wants_more(row):
                row.frame(audience.controls(row))
                audience.observe(row)
                raise_if_signalled()
        finally:
            audience.close()
