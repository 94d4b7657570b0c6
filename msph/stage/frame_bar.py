"""Progress bar of runs with a known number of frames."""

import sys
import time

from tqdm import tqdm

# Time [s] beyond which the bar shows the progress within a frame.
LONG_FRAME = 1.0


class FrameBar:
    """Progress bar of frames, which also shows the progress within slow frames."""

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
        """Takes the completed share (0 to 1) of the current frame; see Show.on_progress."""
        if time.monotonic() - self.since > LONG_FRAME:
            self.since = time.monotonic()
            self.bar.set_postfix_str(f"{100.0 * share:.1f} % of the next")

    def update(self) -> None:
        """Counts a completed frame."""
        self.since = time.monotonic()
        self.bar.set_postfix_str("", refresh=False)
        self.bar.update()

    def close(self) -> None:
        self.bar.close()
