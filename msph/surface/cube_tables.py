"""Marching cubes tables, derived by code.

A cell's corner c has the offset (c & 1, c >> 1 & 1, c >> 2 & 1); bit c of a case is set if the
corner is inside (f > 0). For every case the contour is traced over the six faces, its segments are
linked into loops, and each loop is triangulated.

Two rules make the meshes of neighbouring cells fit. (1) An ambiguous face (inside corners
diagonally opposite) always separates its inside corners. The rule depends on the face alone, so
both cells that share it make the same segments. (2) No triangulation uses a diagonal between two
edges of one face: if the neighbour made the same diagonal, four triangles would share that mesh
edge. Every loop of rule 1 has such a triangulation; otherwise `triangulate` fails at import.
"""

from itertools import combinations

import numpy as np

CORNERS = np.array([(c & 1, c >> 1 & 1, c >> 2 & 1) for c in range(8)], dtype=np.int32)

# Edge 4 a + k runs along axis a from the k-th corner whose coordinate a is 0.
EDGES = np.array(
    [(c, c | 1 << a) for a in range(3) for c in range(8) if not c >> a & 1], dtype=np.int32
)
EDGE_AXIS = np.repeat(np.arange(3, dtype=np.int32), 4)
EDGE_NUMBER = {frozenset(edge): e for e, edge in enumerate(EDGES.tolist())}


def face_cycles() -> list[list[int]]:
    """Returns the four corners of each face (axis a, side 0, 1), counter-clockwise from outside."""
    cycles = []
    for a in range(3):
        b, c = (a + 1) % 3, (a + 2) % 3
        ring = [u << b | v << c for u, v in ((0, 0), (1, 0), (1, 1), (0, 1))]
        cycles += [ring[::-1], [corner | 1 << a for corner in ring]]
    return cycles


FACES = face_cycles()
EDGE_FACES = [{f for f, ring in enumerate(FACES) if {p, q} <= set(ring)} for p, q in EDGES.tolist()]


def face_segments(case: int, ring: list[int]) -> list[tuple[int, int]]:
    """Returns the directed contour segments (from edge, to edge) of a face, one per run of inside
    corners.

    Along the counter-clockwise cycle a segment leads from the start of a run to its end; the cell
    behind the face has the reversed segment, which makes the winding consistent.
    """
    inside = [case >> corner & 1 for corner in ring]
    segments = []
    for k in range(4):
        if inside[k] and not inside[(k + 1) % 4]:
            first = k
            while inside[first - 1]:
                first -= 1
            leave = EDGE_NUMBER[frozenset((ring[k], ring[(k + 1) % 4]))]
            enter = EDGE_NUMBER[frozenset((ring[first - 1], ring[first]))]
            segments.append((enter, leave))
    return segments


def loops(case: int) -> list[list[int]]:
    """Returns the closed contour loops of a case, as lists of edge numbers."""
    follow = dict(segment for ring in FACES for segment in face_segments(case, ring))
    found = []
    while follow:
        start, edge = follow.popitem()
        loop = [start]
        while edge != start:
            loop.append(edge)
            edge = follow.pop(edge)
        found.append(loop)
    return found


def triangulations(polygon: list[int]):
    """Yields every triangulation of a convex polygon as a list of corner triples."""
    if len(polygon) == 2:
        yield []
        return
    for k in range(1, len(polygon) - 1):
        for left in triangulations(polygon[: k + 1]):
            for right in triangulations(polygon[k:]):
                yield [(polygon[0], polygon[k], polygon[-1]), *left, *right]


def triangulate(polygon: list[int]) -> list[tuple[int, int, int]]:
    """Returns the triangulation without diagonals in faces that has the shortest diagonals (squared
    sum)."""
    middle = CORNERS[EDGES].mean(axis=1)
    sides = {frozenset((polygon[i - 1], polygon[i])) for i in range(len(polygon))}
    best, least = None, np.inf
    for triangles in triangulations(polygon):
        inner = {frozenset(pair) for t in triangles for pair in combinations(t, 2)} - sides
        if any(EDGE_FACES[p] & EDGE_FACES[q] for p, q in inner):
            continue
        length = sum(float(((middle[p] - middle[q]) ** 2).sum()) for p, q in inner)
        if length < least:
            best, least = triangles, length
    if best is None:
        raise ValueError(f"loop {polygon} has no triangulation free of diagonals in a cell face")
    return best


def build() -> tuple[np.ndarray, np.ndarray]:
    """Returns triangle counts (256,) and edge triples (256, max count, 3), padded with -1."""
    cases = [[t for loop in loops(case) for t in triangulate(loop)] for case in range(256)]
    counts = np.array([len(case) for case in cases], dtype=np.int32)
    triangles = np.full((256, counts.max(), 3), -1, dtype=np.int32)
    for case, found in enumerate(cases):
        triangles[case, : len(found)] = np.array(found, dtype=np.int32).reshape(-1, 3)
    return counts, triangles


TRIANGLE_COUNTS, TRIANGLES = build()
