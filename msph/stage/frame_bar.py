"""The progress bar of runs whose frames are counted."""

import sys
import time

from tqdm import tqdm

# Time in which a frame should be over [s]: beyond, the bar tells how far it is.
LONG_FRAME = 1.0


class FrameBar:
    """A progress bar of frames, which in frames that take long tells how far they are."""

    def __init__(self, total: int, shown: bool, initial: int = 0):
        self.bar = tqdm(
            total=total,
            initial=initial,
            unit="frame",
            disable=not shown,
            file=sys.stderr,
            dynamic_ncols=True,
        )
        self.since = time.monotonic()

    def within(self, share: float) -> None:
        """Takes in that a share (0 to 1) of the frame is over; see Show.tell."""
        if time.monotonic() - self.since > LONG_FRAME:
            self.since = time.monotonic()
            self.bar.set_postfix_str(f"{100.0 * share:.1f} % of the next")

    def update(self) -> None:
        """A frame is whole."""
        self.since = time.monotonic()
        self.bar.set_postfix_str("", refresh=False)
        self.bar.update()

    def close(self) -> None:
        self.bar.close()
