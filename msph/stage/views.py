"""Views: the rendered water, or particles coloured by an attribute."""

import math

import numpy as np
import taichi as ti

from msph.launches import data_oriented, kernel
from msph.picture.legend import Legend
from msph.picture.ranges import SteadyRange
from msph.scene.check import views
from msph.scene.schema import Scene
from msph.stage.neighbourhood import Neighbourhood
from msph.state import State, Wanted

# Colour range of the density error [%] by method: typical errors of weak compressibility, and of
# splashes with the projection method.
DENSITY_RANGE = {"classic": 10.0, "projection": 1.0}
# Least upper end of a colour range by unit, and for other units; smaller ranges show noise.
LEAST_ENDS, LEAST_END = {"m/s": 0.1, "Pa": 10.0, "m": 0.01}, 1e-6
# Display unit of values of 1000 and more, and of values up to 0.1, and its size in the base unit.
LARGER, SMALLER = {"Pa": ("kPa", 1e3)}, {"m": ("mm", 1e-3)}


@data_oriented
class ViewFields:
    """Fields (capacity,) of a particle view: value, and radius [m], 0 for hidden particles."""

    def __init__(self, state: State):
        self.particles, self.layers = state.particles, state.layers
        self.value, self.radius = (ti.field(ti.f32, shape=state.room.particles) for _ in range(2))

    @kernel
    def find_radii(self, n: ti.i32, cut: ti.math.vec3, offset: ti.f32):
        """Computes radius = spacing / 2, or 0 where cut . x > offset [m]."""
        for i in range(n):
            radius = 0.5 * self.layers.spacing[self.particles.layer[i]]
            beyond = self.particles.x[i].dot(cut) > offset + 1e-6
            self.radius[i] = 0.0 if beyond else radius

    @kernel
    def scale(self, n: ti.i32, scale: ti.f32, shift: ti.f32):
        """Computes value = scale viewed + shift."""
        for i in range(n):
            self.value[i] = scale * self.particles.viewed[i] + shift


class Views:
    """Views of one state by name, and the scalar field that colours the particles."""

    def __init__(self, state: State, scene: Scene):
        self.state = state
        self.rest_density = scene.density
        self.density_range = DENSITY_RANGE[scene.method]
        self.shown = state.build_once(ViewFields)
        self.value, self.radius = self.shown.value, self.shown.radius
        # Direction, in the box frame (3,), in which particles beyond the box's centre are hidden.
        self.cut: np.ndarray | None = None
        self.neighbourhood = Neighbourhood(state)
        self.names = views(scene)
        self.name = scene.picture.view
        self.attributes = state.attributes
        ends = {name: LEAST_ENDS.get(a.unit, LEAST_END) for name, a in self.attributes.items()}
        self.ranges = {name: SteadyRange(end) for name, end in ends.items()}

    def next(self) -> None:
        """Switches to the next view, the first after the last, and clears the picked particle."""
        self.neighbourhood.pick(None)
        self.name = self.names[(self.names.index(self.name) + 1) % len(self.names)]

    @property
    def wanted(self) -> Wanted:
        """What the state must hold for the present view."""
        if self.name == "water":
            return Wanted()
        return Wanted(self.name, self.neighbourhood.id)

    def values(self) -> tuple[ti.Field, float, float]:
        """Returns the scalar field (capacity,) of the view and the range of its colours, in the
        attribute's unit; density errors in %, measured at the current positions."""
        n = self.state.particles.count
        cut = np.zeros(3) if self.cut is None else self.cut
        offset = float(0.5 * np.array(self.state.plan.size) @ cut)
        self.shown.find_radii(n, cut.tolist(), offset)
        if self.neighbourhood.find():
            self.neighbourhood.weigh(self.value, self.radius)
            return self.value, 0.0, 1.0
        if self.name == "particles" or self.state.wanted.view != self.name:
            # A view that was chosen just now has its values in the next frame.
            self.value.fill(0.0)
            return self.value, 0.0, 1.0
        if self.name == "density_error":
            self.shown.scale(n, 100.0 / self.rest_density, -100.0)
            return self.value, -self.density_range, self.density_range
        self.shown.scale(n, 1.0, 0.0)
        if self.name == "layers":
            return self.value, 0.0, max(1.0, self.state.layers.count - 1.0)
        viewed = self.state.particles.numpy("viewed")
        ends = viewed.min(initial=math.inf), viewed.max(initial=-math.inf)
        return self.value, *self.ranges[self.name].cover(*map(float, ends))

    def radii(self) -> np.ndarray:
        """Returns the radius of every particle [m], (count,); 0 for hidden ones."""
        return self.radius.to_numpy()[: self.state.particles.count]

    def legend(self, lo: float, hi: float) -> Legend | None:
        """Returns the legend of the colours from lo to hi, None for a view without a legend."""
        if self.neighbourhood.id is not None:
            return Legend("kernel W(r)/W(0) [-]", ((0.0, "0"), (0.5, "0.5"), (1.0, "1")))
        if self.name == "layers":
            return self._legend_of_layers(hi)
        if self.name == "particles":
            return Legend("particles", ((0.0, "radius: half the spacing"),), bar=False)
        if self.name not in self.attributes:
            return None
        unit = "%" if self.name == "density_error" else self.attributes[self.name].unit
        unit, size = display_unit(unit, max(-lo, hi))
        labelled = (lo, hi, 0.0) if lo < 0.0 else (lo, hi)
        marks = tuple(((v - lo) / (hi - lo), f"{v / size:g}") for v in labelled)
        # The attribute is the solver's own density (docs/method.md, "Density errors").
        title = "solver residual" if self.name == "density_error" else self.name.replace("_", " ")
        return Legend(f"{title} [{unit}]", marks)

    def _legend_of_layers(self, hi: float) -> Legend:
        """Returns the legend of the layers, from fine to coarse."""
        specs = self.state.layers.specs
        order = sorted(range(len(specs)), key=lambda k: specs[k].spacing)
        unit, size = display_unit("m", specs[order[0]].spacing)
        marks = tuple((k / hi, f"{specs[k].spacing / size:.3g}") for k in order)
        return Legend(f"layers: spacing [{unit}]", marks, bar=False)


def display_unit(unit: str, value: float) -> tuple[str, float]:
    """Returns the display unit of a value [unit], and the display unit's size in [unit]."""
    if abs(value) >= 1e3:
        return LARGER.get(unit, (unit, 1.0))
    if abs(value) <= 0.1:
        return SMALLER.get(unit, (unit, 1.0))
    return unit, 1.0
