"""Slides of a lesson: numbered images and a file of captions."""

from pathlib import Path
from typing import Any

import imageio.v2 as imageio

from msph.lesson.board_view import BoardView
from msph.lesson.guide import Guide
from msph.lesson.load import Course
from msph.lesson.paint import band_height
from msph.lesson.student import Student, rehearse
from msph.own_files import claim, replace, replacing
from msph.picture.pixels import as_u8
from msph.stage.link import Order
from msph.stage.preparation import prepare_row
from msph.stage.sheet import text_height

SIZE = (1280, 720)
CAPTIONS = "{}_captions.txt"


def write(course: Course, folder: Path, force: bool = False) -> list[Path]:
    """Writes NAME_01.png, ... with the question, each solved task and the explanation, and
    NAME_captions.txt. Returns the files."""
    captioned = folder / CAPTIONS.format(course.name)
    claim([captioned], force)
    below, row = band_height(text_height(SIZE[1])), None
    view: Any = None
    if course.lesson.board:
        view = BoardView(SIZE, below)
    else:
        row = prepare_row(Order(course.scenes, course.labels), SIZE, below)
    guide = Guide(course, row, SIZE)
    guide.band.keys = guide.reasons.keys = False
    student, lesson = Student(guide.progress, row), course.lesson
    number = 1 + len(lesson.do) + guide.reasons.pages
    claim([slide_path(folder, course, k) for k in range(number)], force)
    captions = [lesson.predict.ask, *(task.text for task in lesson.do), lesson.why.text]
    paths: list[Path] = []

    def slide() -> None:
        guide.shown = guide.progress.shown()
        if row is not None:
            row.draw()
        if view is not None:
            view.draw(guide.progress)
        image = row.image if row is not None else view.image
        guide.draw(image)
        path = slide_path(folder, course, len(paths))
        with replacing(path) as new:
            imageio.imwrite(new, as_u8(image))
        paths.append(path)

    slide()
    student.answer()
    for _ in lesson.do:
        rehearse(student)
        slide()
        guide.progress.go(1)
    for k in range(guide.reasons.pages):
        slide()
        if k:
            captions.append("The code, continued.")
        guide.progress.go(1)
    lines = [f"{path.name}: {text}" for path, text in zip(paths, captions, strict=True)]
    replace(captioned, "\n".join(lines) + "\n")
    return [*paths, captioned]


def slide_path(folder: Path, course: Course, index: int) -> Path:
    """Returns the file of a slide, numbered from 1."""
    return folder / f"{course.name}_{index + 1:02d}.png"
