"""What a picture can show: the water itself, or its particles coloured by any attribute."""

import numpy as np
import taichi as ti

from msph.fluid.simulation import Simulation
from msph.picture.legend import Legend
from msph.picture.ranges import SteadyRange
from msph.scene.check import views
from msph.scene.schema import Scene
from msph.stage.neighbourhood import Neighbourhood
from msph.taichi_internals import data_oriented, kernel

# Colour range of the density error [%] by method: what a weakly compressible one may show, and what
# is left of crowds in a splash where densities are solved for.
DENSITY_RANGE = {"classic": 10.0, "projection": 1.0}
# By unit: the least upper end of a range, below which colours would show noise.
LEAST, TINY = {"m/s": 0.1, "Pa": 10.0, "m": 0.01}, 1e-6
# By unit: the one that numbers from 1000 on, or up to .1, are told in, and its size in the first.
LARGER, SMALLER = {"Pa": ("kPa", 1e3)}, {"m": ("mm", 1e-3)}


@data_oriented
class Views:
    """The views of one simulation, by name, and the scalar field that colours the particles."""

    def __init__(self, simulation: Simulation, scene: Scene):
        self.simulation = simulation
        particles = simulation.particles
        self.rest_density = scene.density
        self.density_range = DENSITY_RANGE[scene.method]
        self.value = ti.field(ti.f32, shape=particles.capacity)
        self.radius = ti.field(ti.f32, shape=particles.capacity)  # [m], 0: hidden
        # Towards what is hidden beyond the box's middle, in its frame (3,); None: all is shown.
        self.cut: np.ndarray | None = None
        self.neighbourhood = Neighbourhood(simulation)
        self.names = views(scene)
        self.name = scene.picture.view
        self.attributes = {a.view: a for a in particles.attributes.values() if a.view}
        self.ranges = {n: SteadyRange(LEAST.get(a.unit, TINY)) for n, a in self.attributes.items()}

    def next(self) -> None:
        """The next view, the first after the last, of all particles."""
        self.neighbourhood.pick(None)
        self.name = self.names[(self.names.index(self.name) + 1) % len(self.names)]

    def values(self) -> tuple[ti.Field, float, float]:
        """The scalar field (capacity,) of the chosen view, and the range of its colours.

        In the attribute's unit, density errors in %, as of now: densities are measured for it.
        """
        particles = self.simulation.particles
        n = particles.count
        cut = np.zeros(3) if self.cut is None else self.cut
        offset = float(0.5 * np.array(self.simulation.size) @ cut)
        self._radii(n, *cut.tolist(), offset)
        if self.neighbourhood.find():
            self.neighbourhood.weigh(self.value, self.radius)
            return self.value, 0.0, 1.0
        if self.name == "particles":
            self.value.fill(0.0)
            return self.value, 0.0, 1.0
        source = particles.fields[self.attributes[self.name].name]
        if self.name == "density_error":
            self.simulation.measure_density()
            self._copy(source, n, 100.0 / self.rest_density, -100.0)
            return self.value, -self.density_range, self.density_range
        if self.name == "layers":
            self._copy(source, n, 1.0, 0.0)
            return self.value, 0.0, max(1.0, self.simulation.layers.count - 1.0)
        if self.attributes[self.name].width == 3:
            self._length(source, n)
        else:
            self._copy(source, n, 1.0, 0.0)
        values = self.value.to_numpy()[:n]
        return self.value, *self.ranges[self.name].cover(float(values.min()), float(values.max()))

    def legend(self, lo: float, hi: float) -> Legend | None:
        """What the colours of the chosen view from lo to hi mean, None where they mean nothing."""
        if self.neighbourhood.id is not None:
            return self.neighbourhood.legend()
        if self.name == "layers":
            return self._legend_of_layers(hi)
        if self.name not in self.attributes:
            return None
        unit = "%" if self.name == "density_error" else self.attributes[self.name].unit
        unit, size = told_in(unit, max(-lo, hi))
        told = (lo, hi, 0.0) if lo < 0.0 else (lo, hi)
        marks = tuple(((v - lo) / (hi - lo), f"{v / size:g}") for v in told)
        return Legend(f"{self.name.replace('_', ' ')} [{unit}]", marks)

    def _legend_of_layers(self, hi: float) -> Legend:
        """A colour each, from fine to coarse."""
        specs = self.simulation.layers.specs
        order = sorted(range(len(specs)), key=lambda k: specs[k].spacing)
        unit, size = told_in("m", specs[order[0]].spacing)
        marks = tuple((k / hi, f"{specs[k].spacing / size:.3g}") for k in order)
        return Legend(f"layers: spacing [{unit}]", marks, bar=False)

    @kernel
    def _radii(self, n: ti.i32, a: ti.f32, b: ti.f32, c: ti.f32, offset: ti.f32):
        """Half a spacing each; none where (a, b, c) . x exceeds offset [m]."""
        p = self.simulation.particles
        for i in range(n):
            radius = 0.5 * self.simulation.layers.spacing[p.layer[i]]
            beyond = p.x[i].dot(ti.Vector([a, b, c])) > offset + 1e-6
            self.radius[i] = 0.0 if beyond else radius

    @kernel
    def _copy(self, source: ti.template(), n: ti.i32, scale: ti.f32, shift: ti.f32):
        for i in range(n):
            self.value[i] = scale * source[i] + shift

    @kernel
    def _length(self, source: ti.template(), n: ti.i32):
        for i in range(n):
            self.value[i] = source[i].norm()


def told_in(unit: str, value: float) -> tuple[str, float]:
    """The unit in which to tell a value [unit], and its size in that unit."""
    if abs(value) >= 1e3:
        return LARGER.get(unit, (unit, 1.0))
    if abs(value) <= 0.1:
        return SMALLER.get(unit, (unit, 1.0))
    return unit, 1.0
