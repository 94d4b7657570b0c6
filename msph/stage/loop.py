"""The frame loop, shared by window, recorder, measurement and benchmark."""

import math
from collections.abc import Sequence
from typing import Any, Protocol

from msph.errors import MsphError
from msph.interrupts import deferred_signals
from msph.stage.controls import Controls
from msph.stage.row import Row


class Audience(Protocol):
    """Client of the frame loop: gives the controls of each frame and processes the result.
    progress: of the run, which the loop advances after each step, None without one."""

    progress: Any = None

    def wants_more(self, row: Row) -> bool: ...

    def controls(self, row: Row) -> Controls:
        return Controls()

    def observe(self, row: Row) -> None: ...

    def close(self) -> None:
        """Called once after the last frame, also after errors."""
        return


class Witness(Protocol):
    """Writes what happens in frames, and gives no input."""

    def given(self, row: Row, controls: Controls) -> None:
        """Called with the controls of a frame before the frame."""
        return

    def observe(self, row: Row) -> None: ...


def run(
    row: Row, audience: Audience, frames: int | None = None, witnesses: Sequence[Witness] = ()
) -> None:
    """Runs frames, at most `frames`, until the audience wants no more, then closes the audience,
    also after errors. Raises InterruptedRun after the step in which a signal arrived; the frame of
    this step is then incomplete."""
    with deferred_signals() as raise_if_signalled:

        def step_done(share: float) -> None:
            if audience.progress:
                audience.progress.within(share, row.lead.pace)
            raise_if_signalled()

        row.lead.on_progress = step_done
        try:
            left = math.inf if frames is None else frames
            while left > 0 and audience.wants_more(row):
                left -= 1
                controls = audience.controls(row)
                for witness in witnesses:
                    witness.given(row, controls)
                row.frame(controls)
                audience.observe(row)
                for witness in witnesses:
                    witness.observe(row)
                raise_if_signalled()
        except MsphError:
            # A signal may have ended the process of the simulation, too.
            raise_if_signalled()
            raise
        finally:
            row.lead.on_progress = None
            audience.close()
