"""The node lattice on which the surface is found, and its bookkeeping in blocks of 4 x 4 x 4.

The lattice is rectilinear: node (i, j, k) sits at (x_i, y_j, z_k). A block owns 4^3 nodes and the
cells whose low corner they are. Blocks are switched on one by one; the nodes that the cells of
active blocks need include the first layer of the next blocks, and a list of all blocks involved
is what the kernels loop over. Nothing outside is ever read, so nothing is ever cleared.
"""

import math

import numpy as np
import taichi as ti

from msph.taichi_internals import data_oriented, kernel

BLOCK = 4
RUNS = BLOCK * BLOCK  # z-runs of 4 nodes per block
# In a walled lattice the wall nodes stand off the wall by about this part of the spacing: no
# triangle at a box edge loses all its area, and the offset is far too small to be seen.
INSET = 2.0**-10


@data_oriented
class Lattice:
    """Coordinates [m] of the nodes along each axis.

    walled: the outermost nodes of each axis are ghosts behind a wall, taken to be outside; the
    surface between them and their neighbours is put on the wall plane, halfway.
    """

    def __init__(self, axes: list[np.ndarray], walled: bool = False):
        self.axes = [np.asarray(a, dtype=np.float32) for a in axes]
        self.shape = tuple(len(a) for a in self.axes)
        self.walled = walled
        self.blocks = tuple(math.ceil(n / BLOCK) for n in self.shape)
        self.padded = tuple(BLOCK * b for b in self.blocks)
        self.coordinate = ti.field(ti.f32, shape=(3, max(self.padded)))
        table = np.zeros(self.coordinate.shape, dtype=np.float32)
        for a in range(3):
            table[a] = np.pad(self.axes[a], (0, max(self.padded) - self.shape[a]), mode="edge")
        self.coordinate.from_numpy(table)

    @classmethod
    def uniform(cls, shape, spacing=(1.0, 1.0, 1.0), origin=(0.0, 0.0, 0.0)) -> "Lattice":
        """Nodes at origin + spacing * index; spacing may differ between axes."""
        triples = zip(shape, spacing, origin, strict=True)
        return cls([o + s * np.arange(n) for n, s, o in triples])

    @classmethod
    def in_box(cls, size: tuple[float, float, float], cell: float) -> "Lattice":
        """Walled lattice over the box (0, 0, 0) to size [m], spacing close to `cell` [m]."""
        return cls([walled_axis(length, cell) for length in size], walled=True)

    @staticmethod
    def shape_in_box(size, cell: float) -> tuple[int, int, int]:
        nx, ny, nz = (intervals(length, cell) + 3 for length in size)
        return nx, ny, nz

    @ti.func
    def point(self, i, j, k):
        """The node's place [m]."""
        return ti.math.vec3(self.coordinate[0, i], self.coordinate[1, j], self.coordinate[2, k])

    @property
    def spacing(self) -> tuple[float, float, float]:
        """Widest distance between neighbouring nodes along each axis [m]."""
        sx, sy, sz = (float(np.diff(a).max()) for a in self.axes)
        return sx, sy, sz


def intervals(length: float, cell: float) -> int:
    """Lattice intervals along a wall-to-wall axis: even, as the band's samples need."""
    return 2 * max(1, round(0.5 * length / cell))


def walled_axis(length: float, cell: float) -> np.ndarray:
    """Node coordinates of one axis: ghost, wall node, interior nodes, wall node, ghost.

    Ghost and wall node mirror each other. Their distance from the wall is a power of two, so both
    sums, and the plane halfway, are exact in f32.
    """
    n = intervals(length, cell)
    inset = 2.0 ** round(math.log2(INSET * length / n))
    x = np.linspace(0.0, length, n + 1)
    wall = float(np.float32(length))
    return np.concatenate([[-inset, inset], x[1:-1], [wall - inset, wall + inset]])


@data_oriented
class Blocks:
    """Which blocks hold surface, and the list of all blocks whose nodes are needed.

    active (bx, by, bz) i32, 1 where the block's cells are to be polygonised; need, same shape,
    bit d set where the block at offset -d, d = dx + 2 dy + 4 dz in 0..7, is active; listed
    (blocks,) i32, linear numbers of the blocks with need != 0, the first count[0] of them live.
    """

    def __init__(self, lattice: Lattice):
        self.lattice = lattice
        self.dims = lattice.blocks
        self.total = int(np.prod(self.dims))
        self.active = ti.field(ti.i32, shape=self.dims)
        self.need = ti.field(ti.i32, shape=self.dims)
        self.listed = ti.field(ti.i32, shape=self.total)
        self.count = ti.field(ti.i32, shape=1)
        # reach_mask[z]: offsets d that use only the axes in z, as bits of `need`.
        masks = [sum(1 << d for d in range(8) if d & ~z == 0) for z in range(8)]
        self.reach_mask = ti.field(ti.i32, shape=8)
        self.reach_mask.from_numpy(np.array(masks, dtype=np.int32))

    @staticmethod
    def bytes_needed(shape: tuple[int, int, int]) -> int:
        return 3 * 4 * math.prod(math.ceil(n / BLOCK) for n in shape)

    def activate_all(self) -> None:
        self.active.fill(1)
        self.count.fill(0)
        self.enlist()

    @ti.func
    def note_need(self, bx, by, bz):
        """Set need of one block from `active`, and list the block if it is needed."""
        bits = 0
        for d in range(8):
            x, y, z = bx - (d & 1), by - (d >> 1 & 1), bz - (d >> 2)
            if x >= 0 and y >= 0 and z >= 0:
                bits |= self.active[x, y, z] << d
        self.need[bx, by, bz] = bits
        if bits != 0:
            slot = ti.atomic_add(self.count[0], 1)
            self.listed[slot] = (bx * self.dims[1] + by) * self.dims[2] + bz

    @kernel
    def enlist(self):
        """active -> need, listed, count; count must be zero before."""
        for b in range(self.total):
            block = self.place(b)
            self.note_need(block[0], block[1], block[2])

    @ti.func
    def place(self, number):
        """Block coordinates of a linear block number."""
        bz = number % self.dims[2]
        rest = number // self.dims[2]
        return ti.Vector([rest // self.dims[1], rest % self.dims[1], bz])

    @ti.func
    def run(self, q):
        """First node of the q-th z-run over all listed blocks, and the block's need bits."""
        block = self.place(self.listed[q // RUNS])
        r = q % RUNS
        node = block * BLOCK + ti.Vector([r // BLOCK, r % BLOCK, 0])
        return node, self.need[block[0], block[1], block[2]]

    @ti.func
    def inner_axes(self, node):
        """Bits of the axes along which the node is the first of its block."""
        at = 0
        for a in ti.static(range(3)):
            at |= ti.cast(node[a] % BLOCK == 0, ti.i32) << a
        return at
