"""Session of `play`: runs one scene after another in the same window."""

from dataclasses import replace

from msph.errors import MsphError
from msph.options import AS_GIVEN, AUTO, QUALITIES
from msph.scene.quality import at_quality
from msph.stage.autosave import lost_session, session_file
from msph.stage.choice import Choice, SceneArguments
from msph.stage.ggui_window import Window
from msph.stage.layout import Layout
from msph.stage.link import Files, Order
from msph.stage.loop import run
from msph.stage.lost_display import completing
from msph.stage.player import Player
from msph.stage.preparation import say
from msph.stage.recorded_input import Header
from msph.stage.remote import Remote
from msph.stage.row import Row
from msph.stage.trial import finest_in_real_time, forget

# Time below real time [s] after which the quality that was found for the scene is forgotten.
SLOW = 10.0


class Session:
    """Session in a window. frames: largest number of frames per scene, None for no limit; files: to
    record and to replay the input of the first scene."""

    def __init__(
        self,
        window: Window,
        remote: Remote,
        arguments: SceneArguments,
        frames: int | None = None,
        files: Files | None = None,
    ):
        self.window, self.remote = window, remote
        self.arguments, self.frames = arguments, frames
        self.layout = Layout(window.size)
        self.message = ""  # shown when the next scene begins
        self.files = files or Files()
        # A recording or replay begins with the scene, not with the state of a lost session.
        self.lost = lost_session(arguments) if self.files == Files() else None

    def play(self, scene: str, quality: str) -> None:
        """Plays a scene and each scene chosen next; returns to the previous scene if a scene cannot
        be built. Raises ClosedError if the window is closed during preparation."""
        before: Choice | None = None
        choice: Choice | None = Choice(scene, quality)
        # The simulations end before the file of the session is removed.
        with session_file() as self.autosave, self.remote:
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
        scenes, quality = self.arguments.scenes_of(choice.scene), choice.quality
        first = next(iter(scenes.values()))
        self.window.begin(first.title or choice.scene)
        if quality == AUTO and len(scenes) > 1:
            # Scenes are compared at their own resolution.
            quality = AS_GIVEN
        elif quality == AUTO:
            quality = finest_in_real_time(first, choice.scene, self.window, self.remote)
        choice = replace(choice, found=quality)
        tried = [at_quality(scene, quality, choice.scene) for scene in scenes.values()]
        files, self.files = self._files_of(choice), Files()
        order = Order(tried, list(scenes), files)
        return self.remote.row(order, self.window.size, self.window.report), choice

    def _files_of(self, choice: Choice) -> Files:
        """Returns the files of a choice: recording and replay are those of the first scene."""
        more = self.arguments.overrides_of(choice.scene), self.arguments.beside
        header = Header.of(choice.scene, choice.quality_now, *more)
        return replace(self.files, autosave=self.autosave, header=header, resume=choice.resume)

    def _play(self, row: Row, choice: Choice) -> Choice | None:
        """Plays until the window is closed or another scene is chosen; returns the choice."""
        player = Player(self.window, row, choice, self.layout, self.arguments)
        player.lost, self.lost = self.lost, None
        if self.message:
            self.layout.show_message(self.message)
            self.message = ""
        with completing(player.close):
            run(row, player, self.frames)
        for show in row.shows:
            for warning in show.warnings():
                say(f"warning: {warning}")
        finer = choice.quality == AUTO and choice.found != QUALITIES[0]
        if finer and player.pacer.longest_slow > SLOW:
            forget(next(iter(self.arguments.scenes_of(choice.scene).values())), self.window)
        return player.next_choice
