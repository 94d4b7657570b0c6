"""The lattice and the numbers of the loaded scene, on the device, where kernels read them."""

from typing import Any

import numpy as np
import taichi as ti

from msph.device_table import DeviceTable, f32, i32
from msph.surface.lattice import PAIR, RUN, Lattice
from msph.surface.room import SurfaceRoom
from msph.taichi_internals import data_oriented

vec3, ivec3 = ti.math.vec3, ti.math.ivec3

# Nodes of a z-row in a word of signs.
WORD = 32
# Of the lattice: nodes along each axis, and padded; pairs of rows along x and y, and of nodes along
# z; words of a z-row; runs of a z-row; the longest padded axis [nodes]; whether ghosts surround it.
LATTICE = {
    "nodes": ivec3,
    "padded": ivec3,
    "pairs": ivec3,
    "words": i32,
    "runs": i32,
    "longest": i32,
    "walled": i32,
}
# Of the scene: the box [m], numbers of layers and of bodies, the largest reach of a kernel [m], the
# slope of coverage at a plane [1/m], bounds of coverage for air and for deep water (-), half the
# diagonal of a sub-block and its edges [m], the least and the largest shift (-).
SCENE = {
    "size": vec3,
    "layers": i32,
    "bodies": i32,
    "widest": f32,
    "slope": f32,
    "air_below": f32,
    "deep_above": f32,
    "half": f32,
    "edges": vec3,
    "least": f32,
    "most": f32,
}


@data_oriented
class DeviceLattice:
    """Indices into the flat arrays over nodes, words and pairs, and the nodes' coordinates.

    numbers: LATTICE and SCENE. Kernels read a vector of them whole, `nodes = numbers.nodes[None]`:
    of a component read at once Taichi does not know that it is not what a loop sums up, and then
    keeps no sums by thread. Arrays over nodes are in the order of the padded lattice, z first.
    """

    def __init__(self, room: SurfaceRoom):
        self.numbers = DeviceTable((), **LATTICE, **SCENE)
        # [m], the axes one after the other, each as long as the longest.
        self.coordinate = DeviceTable((3 * room.axis,), x=f32)

    def load(self, lattice: Lattice, **scene: Any) -> None:
        """scene: values of SCENE, which marching cubes alone do not need."""
        rows = lattice.rows()
        self.numbers.fill(
            nodes=lattice.shape,
            padded=lattice.padded,
            pairs=[-(-n // PAIR) for n in lattice.shape],
            words=-(-lattice.shape[2] // WORD),
            runs=lattice.padded[2] // RUN,
            longest=len(rows[0]),
            walled=lattice.walled,
            **(scene or {name: np.zeros(getattr(kind, "n", 1)) for name, kind in SCENE.items()}),
        )
        self.coordinate.fill(x=np.concatenate(rows))

    @ti.func
    def at(self, node):
        """Index of a node (i, j, k)."""
        padded = self.numbers.padded[None]
        return (node[0] * padded[1] + node[1]) * padded[2] + node[2]

    @ti.func
    def word(self, i, j, w):
        """Index of the w-th word of the row (i, j)."""
        nodes = self.numbers.nodes[None]
        return (i * nodes[1] + j) * self.numbers.words[None] + w

    @ti.func
    def pair(self, i, j, w):
        """Index of the w-th word of the pair of rows that holds the row (i, j)."""
        pairs = self.numbers.pairs[None]
        return (i // PAIR * pairs[1] + j // PAIR) * self.numbers.words[None] + w

    @ti.func
    def point(self, node):
        """A node's place [m]."""
        longest = self.numbers.longest[None]
        x, y = self.coordinate.x[node[0]], self.coordinate.x[longest + node[1]]
        return vec3(x, y, self.coordinate.x[2 * longest + node[2]])
