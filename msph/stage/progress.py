"""Progress of a run with a known number of frames: bar, lines in a log, and the expected time."""

import sys
import time
from collections.abc import Callable

from tqdm import tqdm

from msph.errors import BadInputError
from msph.launches import compile_time
from msph.scene.effort import in_words

# Time [s] beyond which the bar shows the progress within a frame, and beyond which a line says why
# the frame takes long.
LONG_FRAME, SLOW_FRAME = 1.0, 3.0
# Longest expected time of a run [s]: one day.
LONGEST_RUN = 86400.0
# Least number of frames between two estimates; steps of 1e-9 s can vanish by rounding.
LEAST_PROGRESS = 1e-12
# Growth of the expected time beyond which the time is printed again (-).
GROWTH = 3.0
# Without a terminal, a line is printed for each of this many parts of the run.
LINES = 10


def running_time() -> float:
    """Returns the time [s] of a clock that stops while kernels compile: compiling takes as long as
    hundreds of frames, and only once."""
    return time.monotonic() - compile_time()


class TooLongError(BadInputError):
    """A run that is expected to take more than a day."""


class Progress:
    """Progress of `total` frames, of which `initial` are already done, on stderr if `shown`: a bar
    on a terminal, otherwise a line per tenth, both with the time left at the pace of the frames
    after the first. Slow frames are explained in one line if `shown` or `explained`.

    clock: running_time, or a test double.
    """

    def __init__(
        self,
        total: int,
        shown: bool,
        initial: int = 0,
        clock: Callable[[], float] = running_time,
        explained: bool = False,
    ):
        terminal = sys.stderr.isatty()
        self.bar = tqdm(
            total=total,
            initial=initial,
            unit="frame",
            disable=not (shown and terminal),
            file=sys.stderr,
            dynamic_ncols=True,
        )
        self.total, self.done = total, initial
        self.explained, self.lines = shown or explained, shown and not terminal
        self.clock = clock
        # Start of the run, and of the bar's last change within the frame [s].
        # Time [s] and number of frames at the last estimate.
        self.start()
        # Time [s] and number of frames at the end of the first frame, which waits for kernels to
        # compile, in another process, too.
        self.first: tuple[float, int] | None = None
        # The expected time [s] printed last; True if the last estimate exceeded LONGEST_RUN.
        self.expected, self.too_long = 0.0, False

    def start(self) -> None:
        """Starts the clock, if the frames begin later than this object."""
        self.begin = self.since = self.clock()
        self.seen = self.begin, float(self.done)

    def within(self, share: float, pace: Callable[[], str]) -> None:
        """Displays the completed share (0 to 1) of the current frame; pace: returns how the frame
        advances, in words. Raises TooLongError for a run that is expected to take over a day."""
        now = self.clock()
        if now - self.since > LONG_FRAME:
            self.since = now
            self.bar.set_postfix_str(f"{100.0 * share:.1f} % of the next")
        if now - self.seen[0] > SLOW_FRAME:
            self._look(now, self.done + share, pace)

    def _look(self, now: float, frames: float, pace: Callable[[], str]) -> None:
        """Estimates the time left from the pace since the last estimate."""
        done = max(frames - self.seen[1], LEAST_PROGRESS)
        left = (self.total - frames) * (now - self.seen[0]) / done
        self.seen = now, frames
        line = f"frame {self.done + 1} of {self.total} takes long: {pace()}"
        # The first estimate may include a pause of the machine.
        if self.too_long and left > LONGEST_RUN:
            raise TooLongError(f"{line}; the run would take {in_words(left)}, more than a day")
        self.too_long = left > LONGEST_RUN
        if self.explained and not self.too_long and left > GROWTH * self.expected:
            self.expected = left
            tqdm.write(f"{line}; the run takes about {in_words(left)}", file=sys.stderr)

    def update(self) -> None:
        """Counts a completed frame."""
        self.done += 1
        self.since = self.clock()
        self.seen = self.since, float(self.done)
        self.bar.set_postfix_str("", refresh=False)
        if self.first is None:
            self.first = self.since, self.done
            self.bar.initial = self.bar.n = self.bar.last_print_n = self.done
            self.bar.unpause()
            self.bar.refresh()
        else:
            self.bar.update()
        if self.lines and self.done * LINES // self.total > (self.done - 1) * LINES // self.total:
            line = f"{100 * self.done // self.total} %: frame {self.done} of {self.total}, "
            tqdm.write(line + self._times(), file=sys.stderr)

    def _times(self) -> str:
        """Returns the time spent and the time left, if it is known, in words."""
        spent, (since, done) = in_words(self.since - self.begin), self.first or (0.0, self.done)
        left = self.total - self.done
        if not left or self.done == done:
            return spent
        pace = (self.since - since) / (self.done - done)
        return f"{spent}, {in_words(left * pace)} left"

    def close(self) -> None:
        self.bar.close()
