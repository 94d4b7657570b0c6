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

import math
from functools import cache
from itertools import product

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
# Squared distances between the middles of edges, infinite for two edges of one face.
MIDDLES = CORNERS[EDGES].mean(axis=1)
DIAGONALS = np.where(
    [[bool(p & q) for q in EDGE_FACES] for p in EDGE_FACES],
    math.inf,
    ((MIDDLES[:, None] - MIDDLES) ** 2).sum(axis=2),
).tolist()


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


@cache
def triangulations(n: int) -> list[tuple[list[tuple[int, int, int]], set[tuple[int, int]]]]:
    """Returns every triangulation of a convex polygon of n corners: its triangles, and its
    diagonals, by numbers of corners in rising order."""
    if n == 2:
        return [([], set())]
    found = []
    for k in range(1, n - 1):
        for left, right in product(triangulations(k + 1), triangulations(n - k)):
            triangles = [*left[0], *(tuple(c + k for c in t) for t in right[0])]
            sides = {(0, k)} if k > 1 else set()
            sides |= {(k, n - 1)} if k < n - 2 else set()
            moved = {(a + k, b + k) for a, b in right[1]}
            found.append(([(0, k, n - 1), *triangles], left[1] | moved | sides))
    return found


def triangulate(polygon: list[int]) -> list[tuple[int, ...]]:
    """Returns the triangulation without diagonals in faces that has the shortest diagonals (squared
    sum)."""

    def length(found) -> float:
        return sum(DIAGONALS[polygon[a]][polygon[b]] for a, b in found[1])

    best = min(triangulations(len(polygon)), key=length)
    if length(best) == math.inf:
        raise ValueError(f"loop {polygon} has no triangulation free of diagonals in a cell face")
    return [tuple(polygon[c] for c in triangle) for triangle in best[0]]


def build() -> tuple[np.ndarray, np.ndarray]:
    """Returns triangle counts (256,) and edge triples (256, max count, 3), padded with -1."""
    cases = [[t for loop in loops(case) for t in triangulate(loop)] for case in range(256)]
    counts = np.array([len(case) for case in cases], dtype=np.int32)
    triangles = np.full((256, counts.max(), 3), -1, dtype=np.int32)
    for case, found in enumerate(cases):
        triangles[case, : len(found)] = np.array(found, dtype=np.int32).reshape(-1, 3)
    return counts, triangles


TRIANGLE_COUNTS, TRIANGLES = build()
