"""What `msph lesson` does: lists, runs in a window, writes pages and slides."""

from pathlib import Path

import click
from tabulate import tabulate

from msph import user_cache
from msph.device import start
from msph.errors import BadInputError, BlowUpError
from msph.lesson import slides, web
from msph.lesson.guide import Guide
from msph.lesson.load import Course, load_lesson, shipped_lessons
from msph.lesson.paint import band_height
from msph.lesson.reader import read
from msph.scene.load import read_toml
from msph.stage.loop import run
from msph.stage.pages import text_height
from msph.stage.player import Choice, Player
from msph.stage.preparation import prepare_row
from msph.stage.window import ClosedError, NoWindowError, Window, check_display


class NoLessonWindowError(BadInputError):
    """A lesson needs a window, and none can be opened."""


def lesson(name, html, slides, size, frames, arch, threads) -> None:
    """As its options say."""
    if name is None:
        if html or slides:
            raise click.UsageError("--html and --slides need the NAME of a lesson")
        click.echo(tabulate(listed(), tablefmt="plain"))
        return
    course = load_lesson(name)
    if html or slides:
        start(arch, threads)
        write(course, html, slides)
    else:
        in_window(course, size, frames, arch, threads)


def listed() -> list[tuple[str, str, str]]:
    """Name, title and progress of each."""
    rows = []
    for name, path in shipped_lessons().items():
        data = read_toml(path)
        kept = user_cache.recall(key(name), {}).get("ticked", [])
        done = f"{sum(kept)} of {len(kept)} done" if any(kept) else ""
        rows.append((name, str(data.get("title", "")), done))
    return rows


def key(name: str) -> str:
    """Under which the progress in a lesson is remembered."""
    return f"lesson {name}"


def write(course: Course, html: Path | None, slides_folder: Path | None) -> None:
    """The page, the slides, or both; names the files."""
    if html:
        for path in web.write(course, html):
            click.echo(path)
    if slides_folder:
        for path in slides.write(course, slides_folder):
            click.echo(path)


def in_window(course: Course, size, frames: int | None, arch, threads) -> None:
    """Runs it until the window is closed; what was done is remembered."""
    try:
        check_display()
        start(arch, threads)
        window = Window(course.lesson.title, size)
    except NoWindowError as reason:
        raise NoLessonWindowError(f"{reason}; --html DIR writes the lesson as a page") from None
    try:
        guide = begin(course, window)
        resume(guide, course.name)
        if guide.progress.row is None:
            read(window, guide, frames)
        else:
            play(guide, window, course.name, frames)
        progress = guide.progress
        kept = {"ticked": progress.ticked, "answered": progress.answered}
        user_cache.remember(key(course.name), kept)
    except ClosedError:
        pass
    finally:
        window.close()


def play(guide: Guide, window: Window, name: str, frames: int | None) -> None:
    """Plays a lesson's waters. What blows up begins again: some lessons ask for it."""
    row, choice = guide.progress.row, Choice(name, "large")
    assert row is not None
    player = Player(window, row, choice, choice.quality, frames, guide)
    while True:
        try:
            run(row, player)
            return
        except BlowUpError:
            guide.progress.again()
            player.layout.say("the water blew up: it begins again")


def begin(course: Course, window: Window) -> Guide:
    """The guide, with its waters ready."""
    if course.lesson.board:
        return Guide(course, None, window.size)
    below = band_height(text_height(window.size[1]))
    labels = [water.label for water in course.lesson.water]
    row = prepare_row(course.scenes, labels, window.size, window.tell, below)
    return Guide(course, row, window.size)


def resume(guide: Guide, name: str) -> None:
    """Takes up what was done before, and opens the first page that was not."""
    kept, progress = user_cache.recall(key(name), {}), guide.progress
    ticked = kept.get("ticked", [])
    if len(ticked) != len(progress.ticked) or all(ticked) or not kept.get("answered"):
        return
    progress.answered, progress.ticked = kept["answered"], list(ticked)
    progress.go(1 + ticked.index(False))
