"""What a picture can show: the water itself, or its particles coloured by any attribute."""

import taichi as ti

from msph.fluid.simulation import Simulation
from msph.launch import data_oriented, kernel
from msph.scene.check import views
from msph.scene.schema import Scene

# Colour range of the density error (-): what a weakly compressible method may show.
DENSITY_RANGE = 0.1


@data_oriented
class Views:
    """The views of one simulation, by name, and the scalar field that colours the particles."""

    def __init__(self, simulation: Simulation, scene: Scene):
        self.simulation = simulation
        particles = simulation.particles
        self.rest_density = scene.density
        self.value = ti.field(ti.f32, shape=particles.capacity)
        self.names = views(scene)
        self.name = scene.picture.view

    def next(self) -> None:
        """The next view, the first after the last."""
        self.name = self.names[(self.names.index(self.name) + 1) % len(self.names)]

    def values(self) -> tuple[ti.Field, float, float]:
        """The scalar field (capacity,) of the chosen view, and the range of its colours."""
        particles = self.simulation.particles
        n = particles.count
        if self.name == "density_error":
            self._copy(particles.fields["density"], n, 1.0 / self.rest_density, -1.0)
            return self.value, -DENSITY_RANGE, DENSITY_RANGE
        source = particles.v if self.name == "speed" else particles.fields[self.name]
        vector = self.name == "speed" or particles.attributes[self.name].width > 1
        if vector:
            self._length(source, n)
        else:
            self._copy(source, n, 1.0, 0.0)
        if self.name == "layer":
            return self.value, 0.0, max(1.0, self.simulation.layers.count - 1.0)
        values = self.value.to_numpy()[:n]
        lo, hi = (0.0 if vector else float(values.min())), float(values.max())
        return self.value, lo, max(hi, lo + 1e-6)

    @kernel
    def _copy(self, source: ti.template(), n: ti.i32, scale: ti.f32, shift: ti.f32):
        for i in range(n):
            self.value[i] = scale * source[i] + shift

    @kernel
    def _length(self, source: ti.template(), n: ti.i32):
        for i in range(n):
            self.value[i] = source[i].norm()
