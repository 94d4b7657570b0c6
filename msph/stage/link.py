"""Messages between the process of a window and the process of its simulations.

Window to simulations: an Order for the scenes to run, then a Command for each frame, and END; None
ends the process. Simulations to window: texts of what they do meanwhile, Ready, a list of Answers
to each Command, and SimulationError, each with the serial number of its order (0: of no order), so
that those of an earlier one are ignored. The next Command is sent once the last one is answered,
before its image is drawn, so that both processes work at the same time; the arrays of an Answer
stay valid until the next Answer.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from msph.errors import MsphError
from msph.scene.schema import Scene
from msph.stage.controls import Controls
from msph.stage.recorded_input import Header, Recording
from msph.stage.show import INTERACTIVE
from msph.state import Wanted
from msph.transfer import Packet

END = "end"


@dataclass(frozen=True)
class Files:
    """Files of a session that the process of the simulations reads and writes. record: file for the
    input; replay: recording to replay; autosave: file of the state; header: what the session runs,
    as both files say; resume: checkpoint to continue from."""

    autosave: Path | None = None
    record: Path | None = None
    header: Header | None = None
    replay: Recording | None = None
    resume: Path | None = None


@dataclass(frozen=True)
class Order:
    """Scenes to run side by side, with labels ("" for none). whole: compile all kernels at the
    start, otherwise some in later frames; options: of each Show; frame_time: simulated time of a
    frame [s], None for that of play.fps; frames: number of frames to run, None for no limit;
    numbers: builds the object from a Show whose attributes are the numbers of Wanted; restart:
    message where an unstable simulation begins again, "" if it ends the run; serial: number of this
    order, from 1."""

    scenes: list[Scene]
    labels: list[str] = field(default_factory=lambda: [""])
    files: Files = field(default_factory=Files)
    whole: bool = False
    options: dict[str, Any] = field(default_factory=lambda: INTERACTIVE)
    frame_time: float | None = None
    frames: int | None = None
    numbers: Callable[[Any], Any] | None = None
    restart: str = ""
    serial: int = 0

    def frame_time_of(self, place: int) -> float:
        """Returns the simulated time of a frame of a scene [s]."""
        return self.frame_time or 1.0 / self.scenes[place].play.fps


@dataclass(frozen=True)
class Command:
    """Input of a frame, and what the window needs of each simulation. calls: methods of the lead to
    call before the frame, with their arguments."""

    controls: Controls
    wanted: list[Wanted]
    calls: list[tuple[str, tuple]] = field(default_factory=list)


@dataclass(frozen=True)
class Ready:
    """The simulations are built. names: of the SharedArrays of each; about: number of particles and
    mass of each; Answers with the initial state follow."""

    names: list[str]
    about: list[str]


@dataclass(frozen=True)
class Answer:
    """State of a simulation after a frame, in the set `index` of its arrays; note: message to the
    user; changes: live parameters that differ from their initial values; numbers: as wanted."""

    index: int
    packet: Packet
    note: str
    changes: dict[str, float]
    numbers: dict[str, float]


class SimulationError(MsphError):
    """An error that ended the simulations; code: exit code."""

    def __init__(self, problem: str, code: int = MsphError.EXIT_CODE):
        super().__init__(problem)
        self.EXIT_CODE = code
