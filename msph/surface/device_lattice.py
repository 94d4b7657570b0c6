"""Lattice and surface parameters of the loaded scene in device memory."""

from typing import Any

import numpy as np
import taichi as ti

from msph.device_table import DeviceTable, f32, i32
from msph.launches import data_oriented
from msph.surface.lattice import PAIR, RUN, Lattice
from msph.surface.room import SurfaceRoom

vec3, ivec3 = ti.math.vec3, ti.math.ivec3

WORD = 32  # nodes of a z-row per word of signs


@data_oriented
class DeviceLattice:
    """Indices into the flat arrays over nodes, words and pairs, and the coordinates of nodes.

    numbers: table of the lattice and the scene; kernels must read its vectors whole (DeviceTable).
    Arrays over nodes are in the order of the padded lattice, z fastest.
    """

    def __init__(self, room: SurfaceRoom):
        self.numbers = DeviceTable(
            (),
            nodes=ivec3,  # nodes along each axis
            padded=ivec3,  # padded nodes along each axis
            pairs=ivec3,  # pairs of rows along x and y, and of nodes along z
            words=i32,  # words per z-row
            runs=i32,  # runs per z-row
            longest=i32,  # padded nodes along the longest axis
            walled=i32,  # 1 if ghosts surround the lattice
            # Of the scene:
            size=vec3,  # box [m]
            layers=i32,  # number of layers
            bodies=i32,  # number of bodies
            widest=f32,  # largest reach of a kernel [m]
            slope=f32,  # slope of coverage at a plane [1/m]
            air_below=f32,  # coverage (-) below which a sub-block is air
            deep_above=f32,  # coverage (-) above which a sub-block is deep water
            overlap=f32,  # depth [m] to which a mesh for an image reaches into bodies
            half_diagonal=f32,  # half the diagonal of a sub-block [m]
            block_edges=vec3,  # edges of a sub-block [m]
            min_shift=f32,  # smallest shift of iso (-)
            max_shift=f32,  # largest shift of iso (-)
        )
        # Coordinates of the nodes [m]: the three axes in turn, each padded to the longest.
        self.coordinate = DeviceTable((3 * room.axis,), x=f32)

    def load(self, lattice: Lattice, **scene: Any) -> None:
        """Loads a lattice. scene: values of the scene, 0 if not given."""
        rows = lattice.rows()
        self.numbers.fill(
            nodes=lattice.shape,
            padded=lattice.padded,
            pairs=[-(-n // PAIR) for n in lattice.shape],
            words=-(-lattice.shape[2] // WORD),
            runs=lattice.padded[2] // RUN,
            longest=len(rows[0]),
            walled=lattice.walled,
            **scene,
        )
        self.coordinate.fill(x=np.concatenate(rows))

    @ti.func
    def node_index(self, node):
        padded = self.numbers.padded[None]
        return (node[0] * padded[1] + node[1]) * padded[2] + node[2]

    @ti.func
    def word_index(self, i, j, w):
        """Returns the index of word w of the row (i, j)."""
        nodes = self.numbers.nodes[None]
        return (i * nodes[1] + j) * self.numbers.words[None] + w

    @ti.func
    def pair_index(self, i, j, w):
        """Returns the index of word w of the pair of rows that contains the row (i, j)."""
        pairs = self.numbers.pairs[None]
        return (i // PAIR * pairs[1] + j // PAIR) * self.numbers.words[None] + w

    @ti.func
    def point(self, node):
        """Returns the position [m] of a node."""
        longest = self.numbers.longest[None]
        x, y = self.coordinate.x[node[0]], self.coordinate.x[longest + node[1]]
        return vec3(x, y, self.coordinate.x[2 * longest + node[2]])
