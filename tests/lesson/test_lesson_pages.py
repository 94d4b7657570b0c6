"""Tests of lessons as HTML pages and slides: they are complete."""

import json
import math
import re
import xml.etree.ElementTree as ET

import imageio.v2 as imageio
import numpy as np
import pytest

from msph.lesson import slides, web
from msph.lesson.load import load_lesson
from msph.lesson.schema import SliderOf
from tests.lesson.lesson_kit import BOARDS, LESSONS, TINY, written


def test_a_page_is_complete_and_needs_no_network(tmp_path):
    course = load_lesson("cubes")
    (path,) = web.write(course, tmp_path)
    text = path.read_text(encoding="utf-8")
    lesson = course.lesson
    for wanted in (lesson.title, lesson.why.text, *(task.text for task in lesson.do)):
        assert wanted.replace("'", "&#x27;") in text
    links = re.findall(r'(?:src|href)="([^"]*)"', text)
    assert not [link for link in links if not link.startswith(("data:", "#"))]
    formula = re.search(r"<svg.*?</svg>", text, re.DOTALL)
    assert formula and ET.fromstring(formula[0]).tag.endswith("svg")
    assert len(set(re.findall(r'<p id="verdict"', text))) == 1
    assert json.dumps(lesson.predict.because) in text, "a wrong answer is explained"
    # Regression: a browser's controls covered the labels below a video.
    width, height = map(int, re.search(r"aspect-ratio: (\d+) / (\d+)", text).groups())
    assert width == web.SIZE[0] and height > web.SIZE[1]


def test_no_text_of_a_lesson_becomes_code_of_its_page(tmp_path, monkeypatch):
    """Regression: the text of a number that is shown ended the script that holds it."""
    monkeypatch.setattr(web, "SIZE", (480, 200))
    code = "</script><script>alert(1)</script>"
    attack = code + "'&"  # texts beyond ASCII are refused
    text = TINY.replace('"board.ponds"]', f'"board.ponds # {code}"]')
    for key in ("A small lesson", "How many ponds?", "one", "Raise the threshold.", "They part."):
        text = text.replace(f'"{key}"', f'"{attack}"')
    text = text.replace('"The contour is one line."', f'"{attack}"')
    (path,) = web.write(load_lesson(written(tmp_path / "mine", text)), tmp_path)
    page = path.read_text(encoding="utf-8")
    scripts = re.findall(r"<script.*?</script>", page, re.DOTALL)
    assert len(scripts) == page.count("</script>") == 2 and "<script>alert" not in page
    told = json.loads(re.search(r'json">(.*?)</script>', page, re.DOTALL)[1])[0]["told"]
    assert code in told[0]


@pytest.mark.parametrize("name", BOARDS)
def test_tasks_of_a_page_can_be_completed_with_its_sliders(name, monkeypatch):
    """Regression: a page asked for a scene but had a slider for the quality only."""
    monkeypatch.setattr(web, "SIZE", (480, 200))
    course = load_lesson(name)
    for task, part in zip(course.lesson.do, web.tasks_of(course), strict=True):
        sliders = re.findall(r'<label>(\w+) .*? max="(\d+)" value="(\d+)"', part)
        frames = json.loads(re.search(r'json">(.*?)</script>', part, re.DOTALL)[1])
        assert {slider for slider, *_ in sliders} == set(task.solution.set)
        assert len(frames) == math.prod(int(last) + 1 for _, last, _ in sliders)
        begin = 0
        for _, last, begins in sliders:
            begin = begin * (int(last) + 1) + int(begins)
        assert not frames[begin]["done"] and any(frame["done"] for frame in frames)


def test_a_page_has_the_start_and_the_solution_of_a_slider_with_many_steps():
    """Regression: of 101 steps a page had 12, perhaps without the start or the solution."""
    slider = SliderOf(name="s", lo=0.0, hi=100.0, step=1.0, start=3.0)
    found = web.positions(slider, True, 3.0, 51.0)
    assert {0.0, 3.0, 51.0, 100.0} <= set(found) and found == sorted(found)


def test_pages_with_videos_ask_for_no_input():
    """Regression: texts next to videos told the reader to press keys."""
    asks = re.compile(
        r"\b(press|keys?|drag|sliders?|mouse)\b|(^|[.:,] )(set|tilt|push|raise|lower|turn)\b",
        re.IGNORECASE,
    )
    for course in map(load_lesson, LESSONS):
        for task in () if course.lesson.board else course.lesson.do:
            assert task.watch and not asks.search(task.watch), task.watch


def test_tasks_that_do_not_work_give_a_warning(tmp_path, capsys):
    text = TINY.replace("{ threshold = 6.0 }", "{ threshold = 7.0 }")
    slides.write(load_lesson(written(tmp_path / "vain", text)), tmp_path / "out")
    assert "vain: do.0.solution: does not make the check hold" in capsys.readouterr().err
    text = TINY.replace("board.ponds == 2", "board.ponds > 0")
    web.write(load_lesson(written(tmp_path / "idle", text)), tmp_path / "out")
    assert "idle: do.0.check: holds before the solution" in capsys.readouterr().err


def test_videos_of_a_page_play(tmp_path):
    import base64

    frames = [np.full((48, 64, 3), 8 * k, np.uint8) for k in range(10)]
    path = tmp_path / "video.mp4"
    path.write_bytes(base64.b64decode(web.video(frames).partition(",")[2]))
    assert len(list(imageio.get_reader(path).iter_data())) == 10


def test_slides_are_numbered_and_captioned(tmp_path):
    course = load_lesson("kernels")
    *pictures, captions = slides.write(course, tmp_path)
    assert len(pictures) >= 2 + len(course.lesson.do)
    lines = captions.read_text().splitlines()
    assert [line.partition(":")[0] for line in lines] == [p.name for p in pictures]
    for picture in pictures:
        assert imageio.imread(picture).shape[:2] == slides.SIZE[::-1]
