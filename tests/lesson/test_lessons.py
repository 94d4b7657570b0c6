"""Tests of the shipped lessons: solutions complete the tasks and inaction does not, and their texts
are short and true."""

import math
import re
from types import SimpleNamespace

import numpy as np
import pytest
from codespell_lib import main as codespell

from msph.lesson.course import readable
from msph.lesson.excerpt import ExcerptError, excerpt
from msph.lesson.load import load_lesson
from msph.lesson.numbers import Numbers
from msph.lesson.physics import amplitude, swing_growth
from msph.lesson.quantities import QUANTITIES
from msph.lesson.schema import LINES, WORDS
from msph.scene.library import assets
from msph.scene.load import load_scene
from msph.stage.controls import Controls
from msph.stage.show import Show
from tests.lesson.lesson_kit import BOARDS, LESSONS, answered, ticks_without_input, written
from tests.tiers import slow_but

# Lessons whose quantities are measured in the rendered image.
SEEN = ("light",)
# A lesson with a task that may end in an unstable simulation, which resets its sliders.
UNSTABLE = ("boiling",)


def test_there_are_fifteen_lessons_in_order_physics_first():
    assert len(LESSONS) == 15
    orders = [load_lesson(name).lesson.order for name in LESSONS]
    assert orders == list(range(1, 16))
    assert LESSONS[:5] == ("floating", "pressure", "torricelli", "waves", "boat")


@pytest.mark.parametrize("name", slow_but(("forces", *BOARDS), LESSONS))
def test_solutions_complete_all_tasks_and_inaction_none(name):
    course = load_lesson(name)
    row, progress, student = answered(course, (320, 180) if name in SEEN else None)
    for k, task in enumerate(course.lesson.do):
        by_itself = ticks_without_input(progress, row)
        assert not by_itself, f"task {k + 1} ticks by itself: {progress.shown()}"
        if task.fresh:
            progress.again()
        assert student.work(), f"task {k + 1} does not tick: {progress.shown()}"
        # Regression: the film of `light` ended at an index of 1.311, and its text said 1.33.
        for slider, value in task.solution.set.items():
            assert progress.values[slider] == pytest.approx(value) or name in UNSTABLE
        told = " ".join(progress.reached[k])
        assert "unknown" not in told and re.search(r"\d", told)
        assert progress.go(1)
    assert progress.pauses and progress.page == 1 + len(course.lesson.do)


def test_displayed_numbers_equal_the_ledger():
    course = load_lesson("forces")
    row, progress, student = answered(course)
    student.work()
    show = row.lead
    entry = show.ledger.entries[-1]
    names = progress.names()
    assert names["water"].kinetic_energy == entry.kinetic
    assert names["water"].time == show.simulation.time == pytest.approx(entry.time)
    assert names["gravity"] == course.lesson.do[0].solution.set["gravity"]
    assert math.hypot(*show.scene.gravity) == pytest.approx(names["gravity"])
    # The solver residual is computed again from measured densities, by its formula.
    show.simulation.measure_density()
    density = show.simulation.particles.numpy("density") / show.scene.density
    assert Numbers(show).solver_residual == pytest.approx(
        100.0 * np.maximum(density - 1.0, 0.0).mean(), rel=1e-5
    )
    progress.ticked[0] = False  # an open task shows the current numbers
    shown = dict(line.rsplit(" ", 2)[:2] for line in progress.shown())
    assert float(shown["centre y"]) == pytest.approx(entry.centre[1], rel=1e-3)


def test_captions_are_short_and_spelt_correctly(tmp_path):
    for name in LESSONS:
        lesson = load_lesson(name).lesson
        texts = [lesson.title, lesson.predict.ask, *lesson.predict.choices, lesson.why.text]
        texts += [task.text for task in lesson.do]
        assert all(len(text.split()) <= WORDS for text in texts), name
        (tmp_path / f"{name}.txt").write_text("\n".join(texts))
    assert codespell(str(tmp_path)) == 0


def test_excerpts_equal_the_source():
    for name in LESSONS:
        course = load_lesson(name)
        assert 3 <= len(course.code) <= LINES
        module = course.lesson.why.code.partition(":")[0].replace(".", "/") + ".py"
        source = (assets().parent / module).read_text(encoding="utf-8")
        for line in course.code:
            assert line.strip() in source
    with pytest.raises(ExcerptError, match="no source found for .*Classic.nothing"):
        excerpt("msph.fluid.classic:Classic.nothing")
    with pytest.raises(ExcerptError, match="no line with 'purple'"):
        excerpt("msph.fluid.classic", first="purple")


def test_simulations_have_the_same_name_everywhere():
    """Regression: System 1 was also called "one"."""
    several = [course for course in map(load_lesson, LESSONS) if len(course.scenes) > 1]
    for course in several:
        for known, title in course.titles.items():
            assert title.lower().replace(" ", "_") == known


def test_numbers_are_formatted_without_powers_of_ten():
    told = [readable(v) for v in (0.0, 1.234567, 123456.0, 1.3e-6, -2.5e-9, -1890.0, math.nan)]
    assert told == ["0", "1.235", "123,456", "under 0.001", "under 0.001", "-1,890", "unknown"]


def test_teaching_md_lists_every_lesson_and_every_quantity():
    text = (assets().parent / "docs" / "teaching.md").read_text(encoding="utf-8")
    for name, quantity in QUANTITIES.items():
        assert f"| `{name}` | {quantity.unit} | {quantity.text} |" in text
    for name in LESSONS:
        course = load_lesson(name)
        assert f"| `{name}` | {'abcd'[course.lesson.predict.answer - 1]}: " in text


def test_the_lesson_of_teaching_md_works(tmp_path):
    text = (assets().parent / "docs" / "teaching.md").read_text(encoding="utf-8")
    example = re.search(r"```toml\n(.*?)```", text, re.DOTALL)
    assert example and len([line for line in example[1].splitlines() if line]) < 30
    course = load_lesson(written(tmp_path / "mine", example[1]))
    row, progress, student = answered(course)
    assert not ticks_without_input(progress, row), progress.shown()
    assert student.work(), progress.shown()


@pytest.mark.slow
def test_a_task_is_completed_at_the_values_that_its_text_names():
    """Regression: the page of `light` read "Completed at: index 1.311", and its text 1.33."""
    course = load_lesson("light")
    _, progress, student = answered(course, (320, 180))
    assert student.work()
    for name, value in course.lesson.do[0].solution.set.items():
        assert f"{name} {value}" in progress.reached[0]
        assert progress.values[name] == pytest.approx(value)


def test_amplitudes_and_growth_of_known_oscillations():
    time = np.arange(0.0, 5.0, 0.1)
    assert amplitude(time, 3.0 + 0.02 * np.sin(2.0 * np.pi * time)) == pytest.approx(0.02)
    assert math.isnan(amplitude(time[:15], time[:15])), "shorter than the waves"
    # Of a swing of period 0.8 s that grows by 4 mm per second.
    phase, reach = 2.0 * np.pi * time / 0.8, 0.004 * time
    entries = [
        SimpleNamespace(time=t, gravity=np.zeros(3), centre=(-r * c, 0, 0), momentum=(r * s, 0, 0))
        for t, r, c, s in zip(time, reach, np.cos(phase), np.sin(phase), strict=True)
    ]
    show = SimpleNamespace(ledger=SimpleNamespace(entries=entries))
    assert swing_growth(show) == pytest.approx(0.8 * 0.004, rel=0.05)


@pytest.mark.slow
def test_a_boat_follows_the_waves_at_its_place():
    """Within the 10 % that the lesson states, for the mean of two intervals.

    Regression: a gauge that the boat covers at the wall reads 1.5 times the wave; in this run it
    reaches the wall before 7 s.
    """
    show = Show(load_lesson("boat").scenes[1], 1.0 / 60.0)
    numbers, ratios = Numbers(show), []
    for k in range(1, 7 * 60 + 1):
        show.frame(Controls())
        wave = min(numbers.front_amplitude, numbers.back_amplitude)
        if k in (5 * 60, 7 * 60):
            ratios.append(numbers.heave_amplitude / wave)
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.1), ratios
    show.close()


def test_lift_holds_in_a_gap_too_narrow_for_particles():
    """Regression: pressures in the gap between a held ball and the floor were not counted."""
    ball = {"centre": (0.3, 0.101, 0.3), "radius": 0.1}
    scene = load_scene("still", {"bodies": [ball]})
    show = Show(scene, 1.0 / 60.0)
    numbers = Numbers(show)
    for _ in range(60):
        show.frame(Controls())
    # 0.86 of the displaced weight without the gap, 0.96 with it.
    assert numbers.lift == pytest.approx(9810.0 * 4.0 / 3.0 * math.pi * 0.1**3, rel=0.09)
    show.close()
