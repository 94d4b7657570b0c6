"""Board of smoothing kernels: their shapes, a particle's neighbours, and its density sum."""

from typing import Any, ClassVar

import numpy as np
import taichi as ti
from scipy.spatial.distance import cdist

from msph.fluid.particles import kernels
from msph.lesson import chart
from msph.lesson.boards import Input, choice

# Kernels of density sums, in the order of the slider, from 1.
DENSITY = ("poly6", "spiky", "Wendland C2", "quartic")
NAMES = (*DENSITY, "viscosity")
# Half the edge of the lattice, and of its centre where densities are compared, in spacings.
LATTICE, CENTRE = 7, 2
SEED = 3


@ti.kernel
def shapes(
    r: ti.types.ndarray(dtype=ti.f32, ndim=1),
    h: ti.f32,
    w: ti.types.ndarray(dtype=ti.f32, ndim=2),
):
    """Computes w[k, i] = W_k(r_i, h) [1/m^3] of each kernel, in the order of NAMES."""
    for i in range(r.shape[0]):
        w[0, i] = kernels.poly6(r[i], h)
        w[1, i] = kernels.spiky(r[i], h)
        w[2, i] = kernels.wendland(r[i], h)
        w[3, i] = kernels.quartic(r[i], h)
        w[4, i] = kernels.viscosity(ti.max(r[i], 1e-3 * h), h)


def sampled(r: np.ndarray, h: float) -> np.ndarray:
    """Returns the kernels (kernels, n) at distances r (n,) for the support h, in units of h^-3."""
    w = np.zeros((len(NAMES), len(r)), np.float32)
    shapes(r.astype(np.float32), h, w)
    return w


class Board(chart.Board):
    """Diagram of particles on a disturbed lattice (left) and of kernels (right), in spacings d."""

    INPUTS: ClassVar[dict[str, Input]] = {
        "support": Input("d", 2.45, 1.0, 5.0),
        "kernel": choice(DENSITY, 3),
        "disorder": Input("d", 0.05, 0.0, 0.5),
    }
    NUMBERS: ClassVar[dict[str, str]] = {"neighbours": "-", "density_error": "%"}
    PANELS = (3, 5)

    def __init__(self) -> None:
        super().__init__()
        axis = np.arange(-LATTICE, LATTICE + 1)
        self.lattice = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), -1).reshape(-1, 3)
        self.shifts = np.random.default_rng(SEED).uniform(-1.0, 1.0, self.lattice.shape)
        self.known: dict[tuple[float, ...], dict[str, float]] = {}

    def _places(self, disorder: float) -> np.ndarray:
        return self.lattice + disorder * self.shifts

    def numbers(self, values: dict[str, float]) -> dict[str, float]:
        """Returns, for the particles at the centre, the mean number of neighbours within the
        support and the density error, the root mean square of sum W d^3 - 1 [%]."""
        key = tuple(values[name] for name in self.INPUTS)
        if key not in self.known:
            self.known[key] = self._numbers(*key)
        return self.known[key]

    def _numbers(self, support: float, kernel: float, disorder: float) -> dict[str, float]:
        x = self._places(disorder)
        middle = x[np.abs(self.lattice).max(axis=1) <= CENTRE]
        r = cdist(middle, x)
        near = r < support
        w = sampled(r[near], support)[round(kernel) - 1]
        sums = np.bincount(np.nonzero(near)[0], w, len(middle))
        return {
            "neighbours": float(near.sum(axis=1).mean() - 1.0),
            "density_error": 100.0 * float(np.sqrt(((sums - 1.0) ** 2).mean())),
        }

    def prepare(self, axes: list[Any]) -> None:
        from matplotlib.lines import Line2D

        left, right = axes
        left.set(aspect="equal", xlim=(-4.4, 4.4), ylim=(-4.4, 4.4), xticks=(), yticks=())
        right.set(xlim=(0, 4), xlabel="distance r [spacings d]", ylabel="weight W(r, h)")
        chart.legend(right, [Line2D([], [], label=NAMES[k], **_line(k)) for k in range(len(NAMES))])

    def paint(self, axes: list[Any], values: dict[str, float]) -> None:
        left, right = axes
        support, chosen = values["support"], round(values["kernel"]) - 1
        x = self._places(values["disorder"])
        x = x[self.lattice[:, 2] == 0]
        r = np.linalg.norm(x, axis=1)
        weight = sampled(r, support)[chosen] / sampled(np.zeros(1), support)[chosen, 0]
        left.scatter(x[:, 0], x[:, 1], s=30, color="none", edgecolors=chart.FAINT)
        left.scatter(
            *x[r < support, :2].T, s=90, c=weight[r < support], cmap="viridis", vmin=-0.4, vmax=1
        )
        left.add_patch(_circle(support))
        left.set_title("slice: weight of each neighbour")
        q = np.linspace(0.0, 1.0, 200)
        for k, w in enumerate(sampled(q * support, support)):
            right.plot(q * support, w, **_line(k, k == chosen))
        right.set_ylim(0, 2.2 * sampled(np.zeros(1), support)[chosen, 0])
        numbers = self.numbers(values)
        right.set_title(
            f"{DENSITY[chosen]}: {numbers['neighbours']:.0f} neighbours, density error "
            f"{numbers['density_error']:.2f} %"
        )


def _line(k: int, chosen: bool = False) -> dict[str, Any]:
    """Returns the style of a kernel's line."""
    dashes = "--" if NAMES[k] == "viscosity" else "-"
    width, alpha = (4.5, 1.0) if chosen else (1.6, 0.75)
    return {"ls": dashes, "lw": width, "alpha": alpha, "color": chart.COLOURS[k]}


def _circle(radius: float):
    from matplotlib.patches import Circle

    return Circle((0, 0), radius, fill=False, color=chart.COLOURS[1], lw=2.5)
