"""Session of `play`: runs one scene after another in the same window."""

from msph.errors import MsphError
from msph.options import AS_GIVEN, AUTO
from msph.scene.quality import at_quality
from msph.stage.called import Choice, SceneArguments
from msph.stage.layout import Layout
from msph.stage.loop import run
from msph.stage.lost_display import completing
from msph.stage.player import Player
from msph.stage.preparation import prepare_row, say
from msph.stage.row import Row
from msph.stage.trial import finest_in_real_time
from msph.stage.window import Window


class Session:
    """Session in a window. frames: largest number of frames per scene, None for no limit."""

    def __init__(self, window: Window, arguments: SceneArguments, frames: int | None = None):
        self.window, self.arguments, self.frames = window, arguments, frames
        self.layout = Layout(window.size)
        self.problem = ""  # error of the scene chosen last

    def play(self, scene: str, quality: str) -> None:
        """Plays a scene and each scene chosen next; returns to the previous scene if one cannot be
        built. Raises ClosedError if the window is closed during preparation."""
        before: Choice | None = None
        choice: Choice | None = Choice(scene, quality)
        while choice:
            try:
                row, at = self._build(choice)
            except MsphError as error:
                if before is None:
                    raise
                self.problem = f"{choice.scene}: {error}"
                before, choice = None, before
                continue
            before, choice = choice, self._play(row, choice, at)
            row.close()
            del row

    def _build(self, choice: Choice) -> tuple[Row, str]:
        """Returns the simulations of a choice, and their quality."""
        scenes, quality = self.arguments.scenes_of(choice.scene), choice.quality
        first = next(iter(scenes.values()))
        self.window.begin(first.title or choice.scene)
        if quality == AUTO and len(scenes) > 1:
            # Scenes are compared at their own resolution.
            quality = AS_GIVEN
        elif quality == AUTO:
            quality = finest_in_real_time(first, choice.scene, self.window)
        found = [at_quality(scene, quality, choice.scene) for scene in scenes.values()]
        return prepare_row(found, list(scenes), self.window.size, self.window.report), quality

    def _play(self, row: Row, choice: Choice, quality: str) -> Choice | None:
        """Plays until the window is closed or another scene is chosen; returns the choice."""
        player = Player(self.window, row, choice, quality, self.layout, self.arguments, self.frames)
        if self.problem:
            self.layout.show_message(self.problem)
            self.problem = ""
        with completing(player.close):
            run(row, player)
        for warning in row.warnings():
            say(f"warning: {warning}")
        return player.next_choice
