"""A lesson as one self-contained web page with text, images and videos."""

import base64
import html
import io
import itertools
import json
import tempfile
from pathlib import Path
from string import Template
from typing import Any

import numpy as np

from msph.export.video import even, video_writer
from msph.lesson import typeset
from msph.lesson.course import LessonProgress
from msph.lesson.load import Course, shipped_lessons
from msph.lesson.paint import LETTERS
from msph.lesson.schema import SliderOf
from msph.lesson.student import FRAME, Student, rehearse
from msph.own_files import claim, replace
from msph.stage.link import Order
from msph.stage.preparation import prepare_row

TEMPLATE = Path(__file__).with_name("page.html")
# Size of images and videos [pixels]; a video shows every SKIP-th frame.
SIZE, SKIP = (960, 400), 2
# Height of a browser's controls [pixels at SIZE], below a video: over it they would cover labels.
CONTROLS = 70
# Number of images along a slider: without steps, alone and with others; at most with steps.
POSITIONS, FEW_POSITIONS, MAX_POSITIONS = 9, 5, 12
# Text of a task of simulations, which a page shows in a video.
WATCH = 'The task in the window is: "{}" The video shows its solution.'
# Constant quality of videos, 0 to 10: small files.
QUALITY = 6
# Time [s] that a video continues after its task is completed.
LINGERS = 1.5


def write(course: Course, folder: Path, force: bool = False) -> list[Path]:
    """Writes the page NAME.html, which shows the solution of each task. Returns its path."""
    path = folder / f"{course.name}.html"
    claim([path], force)
    replace(path, page(course, tasks_of(course)))
    return [path]


def page(course: Course, tasks: list[str]) -> str:
    """Returns the HTML of the page; tasks: HTML of each task."""
    lesson, escape, shipped = course.lesson, html.escape, course.name in shipped_lessons()
    pointer = '<p class="note">In the window: <code>msph lesson {}</code></p>'
    choices = (
        f'<button type="button">{LETTERS[k]}&ensp;{escape(choice)}</button>'
        for k, choice in enumerate(lesson.predict.choices)
    )
    return Template(TEMPLATE.read_text(encoding="utf-8")).substitute(
        window=pointer.format(escape(course.name)) if shipped else "",
        film=f"{SIZE[0]} / {SIZE[1] + CONTROLS}",
        title=escape(lesson.title),
        ask=escape(lesson.predict.ask),
        choices="\n".join(choices),
        answer=lesson.predict.answer,
        because=in_script(lesson.predict.because),
        tasks="\n".join(tasks),
        why=escape(lesson.why.text),
        formula=typeset.svg(lesson.why.formula),
        source=escape(lesson.why.code),
        code=escape("\n".join(course.code)),
    )


def in_script(data: Any) -> str:
    """Returns data as JSON for a <script> element. Only strings contain "<", which is escaped, so
    that no string ends the element."""
    return json.dumps(data).replace("<", "\\u003c")


def tasks_of(course: Course) -> list[str]:
    """Returns the HTML of each task: with a video of its solution, or with the board at positions
    of the sliders that its solution moves."""
    row = None if course.lesson.board else prepare_row(Order(course.scenes, course.labels), SIZE)
    progress, frames, count = LessonProgress(course, row), list[np.ndarray](), itertools.count()

    def see() -> None:
        if row is not None and next(count) % SKIP == 0:
            frames.append(row.to_numpy_u8())

    student, parts = Student(progress, row, see, LINGERS), []
    student.answer()
    for k, task in enumerate(course.lesson.do):
        frames.clear()
        moved = [s for s in course.lesson.slider if s.name in task.solution.set]
        shown = flipbook(progress, moved) if row is None else ""
        rehearse(student)
        if row is not None:
            shown = f'<video controls loop muted playsinline src="{video(frames)}"></video>'
        parts.append(part(progress, k, shown, progress.reached[k]))
        progress.go(1)
    return parts


def positions(slider: SliderOf, alone: bool, *others: float) -> list[float]:
    """Returns the values of a slider on a page, in order: steps, or equidistant values, and the
    `others`; alone: True if the page's other sliders do not move."""
    if slider.step:
        number = round((slider.hi - slider.lo) / slider.step) + 1
        chosen = {*np.linspace(0, number - 1, min(number, MAX_POSITIONS)).round().tolist()}
        chosen |= {float(round((value - slider.lo) / slider.step)) for value in others}
        return [slider.lo + k * slider.step for k in sorted(chosen)]
    number = POSITIONS if alone else FEW_POSITIONS
    return sorted({*np.linspace(slider.lo, slider.hi, number).tolist(), *others})


def flipbook(progress: LessonProgress, sliders: list[SliderOf]) -> str:
    """Returns the HTML of the board with these sliders: an image for each combination of their
    positions, with the numbers of the task and whether they complete it."""
    task, begin = progress.task, dict(progress.values)
    assert task is not None
    axes = [
        positions(s, len(sliders) == 1, begin[s.name], task.solution.set[s.name]) for s in sliders
    ]
    frames = []
    for combination in itertools.product(*axes):
        for slider, value in zip(sliders, combination, strict=True):
            progress.move(slider, value)
        image = data_of(png(progress.board.draw(progress.values, SIZE)), "image/png")
        frames.append({"image": image, "told": progress.shown(), "done": progress.holds()})
    ranges = []
    for slider, axis in zip(sliders, axes, strict=True):
        name = html.escape(slider.name.replace("_", " "))
        names = [progress.reading(slider.name, float(f"{value:.3g}")) for value in axis]
        start = axis.index(min(axis, key=lambda value: abs(value - begin[slider.name])))
        ranges.append(
            f'<label>{name} <b></b><input type="range" min="0" max="{len(axis) - 1}" '
            f'value="{start}" data-names="{html.escape(json.dumps(names))}"></label>'
        )
        progress.move(slider, begin[slider.name])
    return (
        f'<div data-frames><img alt="the board at these values">{"".join(ranges)}'
        f"<output></output>"
        f'<script type="application/json">{in_script(frames)}</script></div>'
    )


def part(progress: LessonProgress, k: int, shown: str, reached: list[str]) -> str:
    """Returns the HTML of a task: text, and the board or a video with the numbers at its
    completion."""
    task, board = progress.lesson.do[k], progress.board is not None
    numbers = "; ".join(reached) if reached else "not reached in this run"
    text = task.text if board else task.watch or WATCH.format(task.text)
    end = "" if board else f'<p class="done">Completed at: {html.escape(numbers)}</p>'
    return f"<h2>Task {k + 1}</h2>\n<p>{html.escape(text)}</p>\n{shown}\n{end}"


def video(frames: list[np.ndarray]) -> str:
    """Returns frames (height, width, 3) uint8 as a data URL of an MP4 video."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "video.mp4"
        with video_writer(path, 1.0 / (SKIP * FRAME), quality=QUALITY) as writer:
            for frame in frames:
                writer.append_data(even(frame))
        return data_of(path.read_bytes(), "video/mp4")


def png(pixels: np.ndarray) -> bytes:
    """Returns pixels (height, width, 3) uint8 as a PNG file with 64 colours, enough for boards."""
    from PIL import Image

    file = io.BytesIO()
    image: Any = Image.fromarray(pixels).quantize(64)
    image.save(file, "PNG", optimize=True)
    return file.getvalue()


def data_of(content: bytes, kind: str) -> str:
    """Returns a data URL."""
    return f"data:{kind};base64,{base64.b64encode(content).decode('ascii')}"
