"""Tests of timings: stages within stages, the printed profile, and the age of a process."""

import time

import pytest

from msph.measure.timings import Timings
from msph.stage.benchmark import profile_lines
from tests.command_kit import python


def test_substages_are_timed_only_for_a_profile():
    for profile, expected in ((False, ["fluid"]), (True, ["fluid", "fluid/density"])):
        timings = Timings(profile)
        with timings.stage("fluid"), timings.substage("density"):
            pass
        timings.close_frame()
        assert list(timings.frames[0]) == expected


def test_tree_keeps_the_order_of_the_stages_and_adds_the_rest():
    timings = Timings(profile=True)
    timings.frames = [
        {"fluid": 0.5, "fluid/density": 0.1, "fluid/drift": 0.2, "picture": 0.1},
        {"fluid": 0.7, "fluid/density": 0.3, "fluid/adaptation": 0.2, "picture": 0.3},
    ]
    tree = timings.tree()
    parts = ["density", "drift", "adaptation", "other"]
    assert list(tree) == ["fluid", *(f"fluid/{part}" for part in parts), "picture"]
    assert list(tree.values()) == pytest.approx([0.6, 0.2, 0.1, 0.1, 0.2, 0.2])


def test_profile_is_indented_with_shares_of_the_frame():
    lines = profile_lines({"fluid": 7.5, "fluid/density": 2.5, "picture": 2.5})
    assert [line.split() for line in lines] == [
        ["fluid", "7.50", "ms", "75.0", "%"],
        ["density", "2.50", "ms", "25.0", "%"],
        ["picture", "2.50", "ms", "25.0", "%"],
    ]
    assert [len(line) - len(line.lstrip()) for line in lines] == [2, 4, 2]


def test_age_of_a_process_is_at_most_the_time_waited_for_it():
    age = "from msph.measure.timings import process_age; print(process_age())"
    begin = time.perf_counter()
    told = python("-c", age)
    waited = time.perf_counter() - begin
    # The age is exact to the clock tick of the system, 0.01 s.
    assert 0.5 * waited < float(told.stdout.splitlines()[-1]) < waited + 0.02
