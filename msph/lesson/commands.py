"""Implementation of `msph lesson`: lists lessons, runs one in a window, writes pages and slides."""

import contextlib

import click
from pydantic import BaseModel, Field
from tabulate import tabulate

from msph import user_cache
from msph.device import start
from msph.errors import BadInputError
from msph.lesson import web
from msph.lesson.board_view import read
from msph.lesson.course import LessonProgress
from msph.lesson.guide import Guide
from msph.lesson.load import Course, load_lesson, shipped_lessons
from msph.lesson.numbers import Numbers
from msph.lesson.paint import band_height
from msph.lesson.slides import write as write_slides
from msph.options import AS_GIVEN, RunOptions
from msph.scene.load import read_toml
from msph.stage.choice import Choice, SceneArguments
from msph.stage.ggui_window import Window
from msph.stage.layout import Layout
from msph.stage.link import Order
from msph.stage.loop import run as run_loop
from msph.stage.play_command import opened
from msph.stage.player import Player
from msph.stage.process import simulations
from msph.stage.remote import Remote
from msph.stage.sheet import text_height
from msph.stage.window import ClosedError, NoWindowError, check_display

# Keys that are listed while a lesson is prepared.
KEYS = (
    ("a to d", "answer the question"),
    ("n, b", "next page, previous page"),
    ("r", "restart the task"),
    ("left drag", "move sliders, push the water"),
    ("arrow keys", "tilt the pool"),
    ("right drag", "turn the camera"),
    ("h", "help"),
)
# Smallest window size for a lesson's pages [pixels].
MIN_SIZE = (480, 270)
# Message after a simulation became unstable, as in some tasks.
RESTARTED = "unstable simulation restarted; r also resets the sliders"


class NoLessonWindowError(BadInputError):
    """A lesson needs a window, and none can be opened."""


def lesson(name, html, slides, size, frames, force, run: RunOptions) -> None:
    """Implements `msph lesson`: lists the lessons, or runs or writes the lesson `name`."""
    if name is None:
        if html or slides:
            raise click.UsageError("--html and --slides need the NAME of a lesson")
        click.echo(tabulate(listed(), tablefmt="plain"))
        return
    course = load_lesson(name)
    if size[0] < MIN_SIZE[0] or size[1] < MIN_SIZE[1]:
        raise click.UsageError(f"--size: a lesson needs at least {MIN_SIZE[0]}x{MIN_SIZE[1]}")
    if html or slides:
        start(run.arch, run.threads)
        for write, folder in ((web.write, html), (write_slides, slides)):
            for path in write(course, folder, force) if folder else ():
                click.echo(path)
    else:
        in_window(course, size, frames, run)


def listed() -> list[tuple[str, str, str]]:
    """Returns name, title and progress of each lesson."""
    rows = []
    for name, path in shipped_lessons().items():
        data = read_toml(path)
        before = user_cache.recall(key(name), Kept) or Kept()
        done = f"{sum(before.ticked)} of {len(before.ticked)} done" if any(before.ticked) else ""
        rows.append((name, str(data.get("title", "")), done))
    return rows


def key(name: str) -> str:
    """Returns the key of a lesson's progress in the user's cache."""
    return f"lesson {name}"


def in_window(course: Course, size: tuple[int, int], frames: int | None, run: RunOptions) -> None:
    """Runs a lesson until the window is closed, and stores its progress."""
    guide = None
    with contextlib.ExitStack() as ends, contextlib.suppress(ClosedError):
        try:
            check_display()
            own = not course.lesson.board
            process = ends.enter_context(simulations(run.arch, run.threads, own))
            window = opened(ends, process, run, course.lesson.title, size, KEYS)
        except NoWindowError as reason:
            raise NoLessonWindowError(f"{reason}; --html DIR writes a web page instead") from None
        try:
            remote = ends.enter_context(Remote(*process)) if process else None
            guide = begin(course, window, remote)
            resume(guide.progress)
            if guide.progress.row is None:
                read(window, guide, frames)
            else:
                play(guide, window, course.name, frames)
        finally:
            if guide:
                keep(guide.progress)


def play(guide: Guide, window: Window, name: str, frames: int | None) -> None:
    """Plays a lesson's simulations."""
    row, choice = guide.progress.row, Choice(name, AS_GIVEN)
    assert row is not None
    layout, arguments = Layout(window.size), SceneArguments(name)
    run_loop(row, Player(window, row, choice, layout, arguments, guide), frames)


def begin(course: Course, window: Window, remote: Remote | None) -> Guide:
    """Returns the guide of a lesson with its simulations prepared in the other process."""
    if not remote:
        return Guide(course, None, window.size)
    below = band_height(text_height(window.size[1]))
    order = Order(course.scenes, course.labels, numbers=Numbers, restart=RESTARTED)
    row = remote.row(order, window.size, window.report, below)
    return Guide(course, row, window.size)


class Kept(BaseModel):
    """Stored progress of a lesson: completed tasks, answer (from 1, 0: none), and the checks of the
    tasks, which show whether the lesson has changed."""

    ticked: list[bool] = []
    answered: int = Field(default=0, ge=0)
    checks: list[str] = []


def kept(course: Course) -> Kept:
    """Returns the stored progress of a lesson, empty if its tasks have changed."""
    found = user_cache.recall(key(course.name), Kept)
    known = checks(course)
    valid = (
        found is not None
        and found.checks == known
        and len(found.ticked) == len(known)
        and found.answered <= len(course.lesson.predict.choices)
    )
    return found if found is not None and valid else Kept(ticked=[False] * len(known))


def checks(course: Course) -> list[str]:
    """Returns the checks of a lesson's tasks."""
    return [task.check for task in course.lesson.do]


def resume(progress: LessonProgress) -> None:
    """Restores the stored progress of a lesson if it has open tasks."""
    before = kept(progress.course)
    if before.answered and not all(before.ticked):
        progress.resume(before.answered, before.ticked)


def keep(progress: LessonProgress) -> None:
    """Stores the progress; tasks that were done before stay done."""
    ticked = [a or b for a, b in zip(kept(progress.course).ticked, progress.ticked, strict=True)]
    found = Kept(ticked=ticked, answered=progress.answered, checks=checks(progress.course))
    user_cache.remember(key(progress.course.name), found.model_dump())
