"""Scalar fields sampled on regular lattices, interpolated with gradients in kernels."""

from dataclasses import dataclass

import numpy as np
import taichi as ti

from msph.device_table import DeviceTable, f32, i32
from msph.fluid.particles.layers import MAX_LAYERS
from msph.fluid.room import MAX_BODIES
from msph.launches import data_oriented, kernel

vec3, vec4 = ti.math.vec3, ti.math.vec4

# Largest number of lattices: one for the distance and one per layer of each mesh.
MAX_LATTICES = MAX_BODIES * (MAX_LAYERS + 1)


@dataclass(frozen=True)
class SampleLattice:
    """Lattice with nodes at origin + cell * (i, j, k) [m], i < shape[0] and so on."""

    origin: tuple[float, float, float]
    cell: float
    shape: tuple[int, int, int]

    # Position of the first node in its cell, in cells: faces of meshes often lie at round numbers,
    # and nodes exactly on a face would be neither inside nor outside.
    OFFSET = (0.3819, 0.4142, 0.2679)

    @classmethod
    def covering(
        cls, lo: np.ndarray, hi: np.ndarray, margin: float, cell: float
    ) -> "SampleLattice":
        """Returns a lattice that covers lo to hi, a margin around it [m], and two more cells."""
        first = np.floor((lo - margin) / cell) - 2 + np.array(cls.OFFSET)
        last = np.ceil((hi + margin) / cell) + 2
        nx, ny, nz = (int(n) for n in np.ceil(last - first) + 1)
        x, y, z = (float(v) for v in first * cell)
        return cls((x, y, z), cell, (nx, ny, nz))

    @property
    def nodes(self) -> int:
        return self.shape[0] * self.shape[1] * self.shape[2]


@data_oriented
class SampledFields:
    """Several sampled lattices, stored one after the other in one f32 field.

    linear(), cubic() and spline() return (value, d/dx, d/dy, d/dz) of the interpolant at a point;
    they are valid only where covers() is true.
    """

    def __init__(self, room: int):
        self._lattices = DeviceTable(
            (MAX_LATTICES,), origin=vec3, cell=f32, dims=ti.math.ivec3, offset=i32
        )
        table = self._lattices
        self.origin, self.cell, self.dims = table.origin, table.cell, table.dims
        self.offset, self.value = table.offset, ti.field(f32, shape=room)

    def load(self, lattices: list[SampleLattice], values: list[np.ndarray]) -> None:
        """Loads lattices and the values at their nodes."""
        ends = np.cumsum([lattice.nodes for lattice in lattices])
        self._lattices.fill(
            origin=[lattice.origin for lattice in lattices],
            cell=[lattice.cell for lattice in lattices],
            dims=[lattice.shape for lattice in lattices],
            offset=[0, *ends[:-1]],
        )
        self._write(np.concatenate([v.ravel() for v in values]).astype(np.float32))

    @kernel
    def _write(self, values: ti.types.ndarray(dtype=ti.f32, ndim=1)):
        for k in range(values.shape[0]):
            self.value[k] = values[k]

    @ti.func
    def place(self, m, p):
        """Returns the position of p in lattice m, in cells from its first node."""
        return (p - self.origin[m]) / self.cell[m]

    @ti.func
    def clamped(self, m, p):
        """Returns the point of lattice m nearest to p."""
        span = self.cell[m] * (ti.cast(self.dims[m], ti.f32) - 1.001)
        return ti.math.clamp(p, self.origin[m], self.origin[m] + span)

    @ti.func
    def covers(self, m, p):
        """Returns whether p is inside the lattice by one cell, as cubic() and spline() require."""
        c = self.place(m, p)
        return (c >= 1.0).all() and (c < ti.cast(self.dims[m], ti.f32) - 2.0).all()

    @ti.func
    def node(self, m, n):
        """Returns the place of node n of lattice m in `value`; the next one along z follows."""
        dims = self.dims[m]
        return self.offset[m] + (n[0] * dims[1] + n[1]) * dims[2] + n[2]

    @ti.func
    def linear(self, m, p):
        """Interpolates trilinearly; p outside the lattice is moved to its border."""
        last = ti.cast(self.dims[m], ti.f32) - 1.001
        c = ti.math.clamp(self.place(m, p), 0.0, last)
        n = ti.floor(c, ti.i32)
        f, out = c - n, vec4(0.0)
        for q in range(4):
            a, b = q // 2, q % 2
            first, sx, sy = self.node(m, n + ti.Vector([a, b, 0])), 2.0 * a - 1.0, 2.0 * b - 1.0
            low = self.value[first]
            rise = self.value[first + 1] - low
            v, wx, wy = low + f[2] * rise, 1.0 - a + sx * f[0], 1.0 - b + sy * f[1]
            out += vec4(wx * wy * v, sx * wy * v, wx * sy * v, wx * wy * rise)
        per = 1.0 / self.cell[m]
        return out * vec4(1.0, per, per, per)

    @ti.func
    def cubic(self, m, p):
        """Interpolates by Catmull-Rom splines: smooth gradient, exact for quadratic fields."""
        return self.interpolate(m, p, catmull_rom, catmull_rom_slope)

    @ti.func
    def spline(self, m, p):
        """Interpolates B-spline coefficients: a sixth of the errors of Catmull-Rom."""
        return self.interpolate(m, p, b_spline, b_spline_slope)

    @ti.func
    def interpolate(self, m, p, weights: ti.template(), slopes: ti.template()):
        """Interpolates by weights of the four nodes around p along each axis."""
        c = self.place(m, p)
        n = ti.math.clamp(ti.floor(c, ti.i32), 1, self.dims[m] - 3)
        f = c - n
        wx, wy, wz = weights(f[0]), weights(f[1]), weights(f[2])
        sx, sy, sz = slopes(f[0]), slopes(f[1]), slopes(f[2])
        out = vec4(0.0)
        for a in range(4):
            for b in range(4):
                v, s, first = 0.0, 0.0, self.node(m, n + ti.Vector([a, b, 0]) - 1)
                for k in ti.static(range(4)):
                    v += wz[k] * self.value[first + k]
                    s += sz[k] * self.value[first + k]
                out += vec4(wx[a] * wy[b] * v, sx[a] * wy[b] * v, wx[a] * sy[b] * v, 0.0)
                out.w += wx[a] * wy[b] * s
        per = 1.0 / self.cell[m]
        return out * vec4(1.0, per, per, per)


@ti.func
def catmull_rom(f):
    """Returns the weights of nodes -1, 0, 1, 2 at f in 0..1 (Catmull and Rom 1974)."""
    return 0.5 * vec4(
        f * (-1.0 + f * (2.0 - f)),
        2.0 + f * f * (3.0 * f - 5.0),
        f * (1.0 + f * (4.0 - 3.0 * f)),
        f * f * (f - 1.0),
    )


@ti.func
def catmull_rom_slope(f):
    """Returns the derivatives of the weights by f."""
    return 0.5 * vec4(
        -1.0 + f * (4.0 - 3.0 * f),
        f * (9.0 * f - 10.0),
        1.0 + f * (8.0 - 9.0 * f),
        f * (3.0 * f - 2.0),
    )


@ti.func
def b_spline(f):
    """Returns the weights of coefficients -1, 0, 1, 2 at f in 0..1 (de Boor 1978)."""
    g = 1.0 - f
    return (
        vec4(g * g * g, 4.0 - 3.0 * f * f * (2.0 - f), 4.0 - 3.0 * g * g * (2.0 - g), f * f * f)
        / 6.0
    )


@ti.func
def b_spline_slope(f):
    """Returns the derivatives of the weights by f."""
    g = 1.0 - f
    return 0.5 * vec4(-g * g, f * (3.0 * f - 4.0), g * (4.0 - 3.0 * g), f * f)
