"""Tests of drawings of the method, with their numbers."""

import numpy as np
import pytest

from msph.lesson.board_contours import NUMBERS, contour, open_edges, pair_mesh
from msph.lesson.board_kernels import sampled
from msph.lesson.boards import MODULES, board_of


def test_kernels_of_the_board_integrate_to_one():
    r = np.linspace(1e-4, 2.0, 4001)
    for w in sampled(r, 2.0):
        integral = np.trapezoid(4.0 * np.pi * r**2 * w, r)
        assert integral == pytest.approx(1.0, abs=2e-3)


def test_the_grid_is_figure_4_3_of_the_thesis():
    board = board_of("contours")
    start = {name: given.start for name, given in board.INPUTS.items()}
    assert start["threshold"] == 5.0
    rows = ["01322", "24584", "36793", "17693", "14342"]
    assert [[int(n) for n in row] for row in rows] == NUMBERS.tolist()
    # At threshold 5 there is one pond; at 6 two values of 7 are at opposite corners of a cell.
    assert (board.numbers(start)["ponds"], board.numbers(start)["ambiguous"]) == (1.0, 0.0)
    ponds = [
        board.numbers(start | {"threshold": 6.0, "diagonal": diagonal})["ponds"]
        for diagonal in (1.0, 2.0)
    ]
    assert ponds == [2.0, 1.0]


def test_contours_lie_where_the_numbers_cross_the_threshold():
    for threshold in (2.5, 4.5, 6.5):
        for line in contour(threshold, diagonal=False):
            for column, row in line:
                j, i = int(column), int(row)
                a = NUMBERS[i, j]
                b = NUMBERS[min(i + (row > i), 4), min(j + (column > j), 4)]
                t = max(column - j, row - i)
                assert a + t * (b - a) == pytest.approx(threshold)


def test_adjacent_cubes_fit_only_if_decided_by_their_shared_face():
    assert len(open_edges(pair_mesh(by_face=False))) == 4
    assert open_edges(pair_mesh(by_face=True)) == []


def test_a_drawing_fills_its_image_reuses_its_layout_and_keeps_no_old_content():
    """Regression: each drawing took up to 0.6 s, most of it for the layout."""
    for name in MODULES:
        board = board_of(name)
        values = {name: given.start for name, given in board.INPUTS.items()}
        board.draw(values, (480, 200))
        first = board.draw(values, (480, 200))
        assert first.shape == (200, 480, 3) and first.std() > 10.0
        assert set(board.numbers(values)) == set(board.NUMBERS)
        drawing, number = board.drawing, len(board.drawing.findobj())
        moved = values | {name: given.lo for name, given in board.INPUTS.items()}
        assert np.any(board.draw(moved, (480, 200)) != first)
        assert np.array_equal(board.draw(values, (480, 200)), first)
        assert board.drawing is drawing and len(drawing.findobj()) == number
