from itertools import combinations

import numpy as np
import pytest

from msph.surface import cube_tables


def case_triangles(case: int) -> np.ndarray:
    return cube_tables.TRIANGLES[case, : cube_tables.TRIANGLE_COUNTS[case]]


def open_edges(case: int) -> set[tuple[int, int]]:
    """Returns the directed sides of a case's triangles whose reverse is not a side of the case."""
    sides = [(int(t[m]), int(t[(m + 1) % 3])) for t in case_triangles(case) for m in range(3)]
    assert len(sides) == len(set(sides))
    return {s for s in sides if s[::-1] not in sides}


def test_every_crossed_edge_is_used_and_no_other():
    for case in range(256):
        inside = np.array([case >> c & 1 for c in range(8)])
        crossed = {e for e, (p, q) in enumerate(cube_tables.EDGES) if inside[p] != inside[q]}
        assert set(case_triangles(case).ravel().tolist()) == crossed


def test_unused_entries_of_the_triangle_table_are_minus_one():
    for case in range(256):
        assert (cube_tables.TRIANGLES[case, cube_tables.TRIANGLE_COUNTS[case] :] == -1).all()


def test_inner_edges_never_lie_in_a_face():
    for case in range(256):
        border = {frozenset(s) for s in open_edges(case)}
        for t in case_triangles(case).tolist():
            for p, q in combinations(t, 2):
                if frozenset((p, q)) not in border:
                    assert not cube_tables.EDGE_FACES[p] & cube_tables.EDGE_FACES[q]


@pytest.mark.parametrize("axis", range(3))
def test_neighbours_have_opposite_contours_on_their_common_face(axis):
    """For all pairs of cells, the contour on the common face depends only on the signs of the face,
    and one cell has the reverse of the other's contour."""
    step = 1 << axis

    def face_contour(case, side):
        """Returns the signs of the face's corners and its directed segments, numbered as on the low
        face."""
        face = 2 * axis + side
        signs = tuple(case >> (c | side * step) & 1 for c in range(8) if not c & step)
        segments = set()
        for p, q in open_edges(case):
            if face in cube_tables.EDGE_FACES[p] & cube_tables.EDGE_FACES[q]:
                ends = [frozenset(int(c) & ~step for c in cube_tables.EDGES[e]) for e in (p, q)]
                segments.add((ends[0], ends[1]))
        return signs, segments

    contours = {}
    for case in range(256):
        signs, segments = face_contour(case, 0)
        assert contours.setdefault(signs, segments) == segments
    assert len(contours) == 16
    for case in range(256):
        signs, segments = face_contour(case, 1)
        assert contours[signs] == {(q, p) for p, q in segments}


def test_all_open_edges_lie_in_exactly_one_face():
    for case in range(256):
        for p, q in open_edges(case):
            assert len(cube_tables.EDGE_FACES[p] & cube_tables.EDGE_FACES[q]) == 1


def test_triangles_of_single_corners_face_away_from_the_water():
    for c in range(8):
        middle = cube_tables.CORNERS[cube_tables.EDGES].mean(axis=1)
        a, b, d = middle[case_triangles(1 << c)[0]]
        assert np.dot(np.cross(b - a, d - a), a - cube_tables.CORNERS[c]) > 0


def test_ambiguous_faces_separate_inside_corners():
    """Two diagonally opposite inside corners give two separate triangles, not a connecting band."""
    case = 1 << 0 | 1 << 3
    assert cube_tables.TRIANGLE_COUNTS[case] == 2
    assert len(set(case_triangles(case).ravel().tolist())) == 6
