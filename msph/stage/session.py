"""Session of `play`: runs one scene after another in the same window."""

from dataclasses import dataclass, replace
from pathlib import Path

from msph.errors import MsphError
from msph.options import AS_GIVEN, AUTO, QUALITIES
from msph.scene.errors import SceneError
from msph.scene.quality import at_quality
from msph.stage.autosave import Autosave, Autosaver, lost_session
from msph.stage.called import Choice, SceneArguments
from msph.stage.layout import Layout
from msph.stage.loop import Audience, run
from msph.stage.lost_display import completing
from msph.stage.player import Player
from msph.stage.preparation import prepare_row, say
from msph.stage.recording import Header, Recording
from msph.stage.replaying import InputRecorder, Replayer
from msph.stage.row import Row
from msph.stage.trial import finest_in_real_time, forget
from msph.stage.window import Window

# Time below real time [s] after which the quality that was found for the scene is forgotten.
SLOW = 10.0


@dataclass(frozen=True)
class InputFiles:
    """File to record the input of the first scene in, and a recording to replay in it."""

    record: Path | None = None
    replay: Recording | None = None


class Session:
    """Session in a window. frames: largest number of frames per scene, None for no limit."""

    def __init__(
        self,
        window: Window,
        arguments: SceneArguments,
        frames: int | None = None,
        files: InputFiles | None = None,
    ):
        self.window, self.arguments, self.frames = window, arguments, frames
        self.layout = Layout(window.size)
        self.message = ""  # shown when the next scene begins
        self.files, self.autosave = files or InputFiles(), Autosave(arguments)
        # A recording or replay begins with the scene, not with the state of a lost session.
        self.lost = lost_session(arguments) if self.files == InputFiles() else None

    def play(self, scene: str, quality: str) -> None:
        """Plays a scene and each scene chosen next; returns to the previous scene if a scene cannot
        be built. Raises ClosedError if the window is closed during preparation."""
        before: Choice | None = None
        choice: Choice | None = Choice(scene, quality)
        with self.autosave:
            while choice:
                try:
                    row, choice = self._build(choice)
                except MsphError as error:
                    if before is None:
                        raise
                    self.message = f"{choice.scene}: {error}"
                    before, choice = None, before
                    continue
                before, choice = replace(choice, resume=None), self._play(row, choice)
                row.close()
                del row
                if choice and choice.scene == before.scene:
                    self.message = f"{choice.scene} begins again at quality {choice.quality}"

    def _build(self, choice: Choice) -> tuple[Row, Choice]:
        """Returns the simulations of a choice, and the choice with their quality."""
        scenes, quality, row = self.arguments.scenes_of(choice.scene), choice.quality, None
        first = next(iter(scenes.values()))
        self.window.begin(first.title or choice.scene)
        if quality == AUTO and len(scenes) > 1:
            # Scenes are compared at their own resolution.
            quality = AS_GIVEN
        elif quality == AUTO:
            found = finest_in_real_time(first, choice.scene, self.window)
            quality, row = found.quality, found.row
        if not row:
            tried = [at_quality(scene, quality, choice.scene) for scene in scenes.values()]
            row = prepare_row(tried, list(scenes), self.window.size, self.window.report)
        return row, replace(choice, found=quality)

    def _play(self, row: Row, choice: Choice) -> Choice | None:
        """Plays until the window is closed or another scene is chosen; returns the choice."""
        player = Player(self.window, row, choice, self.layout, self.arguments)
        player.offer, self.lost = self.lost, None
        if choice.resume:
            self._resume(row, choice.resume)
        if self.message:
            self.layout.show_message(self.message)
            self.message = ""
        audience = self._with_files(player, row, choice)
        with completing(audience.close):
            run(row, audience, self.frames)
        for show in row.shows:
            for warning in show.warnings():
                say(f"warning: {warning}")
        finer = choice.quality == AUTO and choice.found != QUALITIES[0]
        if finer and player.pacer.longest_slow > SLOW:
            forget(next(iter(self.arguments.scenes_of(choice.scene).values())), self.window)
        return player.next_choice

    def _resume(self, row: Row, path: Path) -> None:
        """Continues the state of a lost session, whose file becomes the file of this session."""
        try:
            row.lead.resume(path)
            path.replace(self.autosave.path)
        except (SceneError, OSError) as error:
            self.message = f"{path.name}: {error}"

    def _with_files(self, player: Player, row: Row, choice: Choice) -> Audience:
        """Returns the player with the recording, replay and autosave of its input."""
        files, self.files = self.files, InputFiles()
        audience: Audience = player
        if files.replay:
            files.replay.check(row.lead.scene)
            audience = Replayer(audience, files.replay, in_window=True)
        if files.record:
            more = self.arguments.overrides, self.arguments.beside
            header = Header.of(choice.scene, choice.quality_now, *more)
            audience = InputRecorder(audience, files.record, header)
        # Simulations side by side, restored one by one, would no longer be in step.
        return audience if row.composed else Autosaver(audience, self.autosave, choice)
