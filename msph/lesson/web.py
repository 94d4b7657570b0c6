"""A lesson as one page for a browser: text, pictures and videos within it, no network."""

import base64
import html
import io
import json
import tempfile
from pathlib import Path
from string import Template
from typing import Any

import imageio.v2 as imageio
import numpy as np

from msph.lesson import typeset
from msph.lesson.course import Progress
from msph.lesson.load import Course, shipped_lessons
from msph.lesson.paint import LETTERS
from msph.lesson.schema import SliderOf
from msph.lesson.student import FRAME, Student, rehearse
from msph.own_files import claim, replace
from msph.stage.preparation import prepare_row
from msph.stage.recorder import make_writable

TEMPLATE = Path(__file__).with_name("page.html")
# Pictures and videos [pixels]; every other simulated frame is shown.
SIZE, SKIP = (960, 400), 2
# Positions of a slider that has no steps of its own; most of one that has.
POSITIONS, MOST = 9, 12
# Time [s] that a video goes on once its task is done.
LINGERS = 1.5


def write(course: Course, folder: Path, force: bool = False) -> list[Path]:
    """The page, NAME.html in the folder; what its tasks show is what their solutions do."""
    path = folder / f"{course.name}.html"
    make_writable(path)
    claim([path], force)
    tasks = on_board(course) if course.lesson.board else in_water(course)
    replace(path, page(course, tasks))
    return [path]


def page(course: Course, tasks: list[str]) -> str:
    """The whole text; tasks: of each its part."""
    lesson, escape, shipped = course.lesson, html.escape, course.name in shipped_lessons()
    pointer = '<p class="note">In the window: <code>msph lesson {}</code></p>'
    choices = (
        f'<button type="button">{LETTERS[k]}&ensp;{escape(choice)}</button>'
        for k, choice in enumerate(lesson.predict.choices)
    )
    return Template(TEMPLATE.read_text(encoding="utf-8")).substitute(
        window=pointer.format(escape(course.name)) if shipped else "",
        title=escape(lesson.title),
        ask=escape(lesson.predict.ask),
        choices="\n".join(choices),
        answer=lesson.predict.answer,
        tasks="\n".join(tasks),
        why=escape(lesson.why.text),
        formula=typeset.svg(lesson.why.formula),
        source=escape(lesson.why.code),
        code=escape("\n".join(course.code)),
    )


def in_water(course: Course) -> list[str]:
    """Of each task a video of its solution."""
    row = prepare_row(course.scenes, course.labels, SIZE)
    progress, frames = Progress(course, row), list[np.ndarray]()
    count = 0

    def see() -> None:
        nonlocal count
        if count % SKIP == 0:
            frames.append(row.picture.to_numpy_u8())
        count += 1

    student, parts = Student(progress, row, see, LINGERS), []
    student.answer()
    for k in range(len(course.lesson.do)):
        frames.clear()
        rehearse(student)
        shown = f'<video controls loop muted playsinline src="{video(frames)}"></video>'
        parts.append(part(progress, k, shown, progress.reached[k]))
        progress.go(1)
    return parts


def on_board(course: Course) -> list[str]:
    """Of each task its drawing at the positions of the slider that its solution moves."""
    progress, parts = Progress(course, None), []
    student = Student(progress, None)
    student.answer()
    for k, task in enumerate(course.lesson.do):
        slider = next(s for s in course.lesson.slider if s.name in task.solution.set)
        others = {n: v for n, v in task.solution.set.items() if n != slider.name}
        frames = positions(progress, slider, others)
        rehearse(student)
        parts.append(part(progress, k, flipbook(slider, frames), progress.reached[k]))
        progress.go(1)
    return parts


def positions(
    progress: Progress, slider: SliderOf, others: dict[str, float]
) -> list[dict[str, str]]:
    """The board along a slider, the others as the solution leaves them: pictures, and words."""
    steps = POSITIONS
    if slider.step:
        steps = min(MOST, round((slider.hi - slider.lo) / slider.step) + 1)
    found = []
    for value in np.linspace(slider.lo, slider.hi, steps).tolist():
        if slider.step:
            value = slider.lo + round((value - slider.lo) / slider.step) * slider.step
        values = {**progress.values, **others, slider.name: value}
        pixels = progress.board.draw(values, SIZE)
        told = ", ".join(
            f"{name.replace('_', ' ')} {v:.4g}"
            for name, v in progress.board.numbers(values).items()
        )
        found.append(
            {
                "image": data_of(png(pixels), "image/png"),
                "told": f"{slider.name.replace('_', ' ')} {value:.3g}: {told}",
            }
        )
    return found


def flipbook(slider: SliderOf, frames: list[dict[str, str]]) -> str:
    """Pictures along a slider."""
    name = html.escape(slider.name.replace("_", " "))
    return (
        f'<div data-frames><img alt="the drawing at this position of {name}">'
        f'<label>{name} <input type="range" min="0" max="{len(frames) - 1}" value="0"></label>'
        f"<output></output>"
        f'<script type="application/json">{json.dumps(frames)}</script></div>'
    )


def part(progress: Progress, k: int, shown: str, reached: list[str]) -> str:
    """A task: what to do, what is seen, and the numbers when it is done."""
    task = progress.lesson.do[k]
    told = "; ".join(reached) if reached else "not reached in this run"
    return (
        f"<h2>Do {k + 1}</h2>\n<p>{html.escape(task.text)}</p>\n{shown}\n"
        f'<p class="done">Ticked at: {html.escape(told)}</p>'
    )


def video(frames: list[np.ndarray]) -> str:
    """Frames (height, width, 3) uint8 as a data address of an MP4."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "video.mp4"
        fps = 1.0 / (SKIP * FRAME)
        writer: Any
        with imageio.get_writer(path, fps=fps, quality=6, macro_block_size=1) as writer:
            for frame in frames:
                height, width = frame.shape[:2]
                writer.append_data(frame[: height // 2 * 2, : width // 2 * 2])
        return data_of(path.read_bytes(), "video/mp4")


def png(pixels: np.ndarray) -> bytes:
    """(height, width, 3) uint8 as a file's bytes, in a palette: flat drawings have few colours."""
    from PIL import Image

    file = io.BytesIO()
    image: Any = Image.fromarray(pixels).quantize(64)
    image.save(file, "PNG", optimize=True)
    return file.getvalue()


def data_of(content: bytes, kind: str) -> str:
    """A data address."""
    return f"data:{kind};base64,{base64.b64encode(content).decode('ascii')}"
