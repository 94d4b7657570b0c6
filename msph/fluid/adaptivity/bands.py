"""Depth bands: assignment of layers to distances from the free surface."""

from dataclasses import replace

import numpy as np

from msph.fluid.particles.layers import LayerSpec
from msph.parameter import Section, parameter

# Tolerance (-) of the mass ratio 2 between layers that split and merge into each other.
RATIO_TOLERANCE = 0.01


class AdaptationParameters(Section):
    """Parameters of splitting and merging. Evidence for the defaults: docs/method.md."""

    enabled: bool = parameter(False, text="split and merge particles by their depth")
    capacity: int | None = parameter(
        None,
        gt=0,
        text="largest number of particles; near it, fine layers become thinner. Default: number "
        "for all water in the finest layer, at most the larger of 16,000 and twice the initial one",
    )
    band: float = parameter(
        1.25, ge=0.5, le=50.0, text="thickness of a layer's band, in its supports"
    )
    hysteresis: float = parameter(
        0.3, ge=0.0, le=0.4, text="share of a band's limit by which particles must exceed it"
    )
    every: int = parameter(8, ge=1, text="least number of steps between passes")
    travel: float = parameter(
        4.0, ge=0.0, text="least distance of the fastest particle between passes, in spacings"
    )
    budget: float = parameter(
        0.1,
        gt=0.0,
        le=1.0,
        text="largest share of the particles that a pass may split, and that it may merge",
    )
    settle: int = parameter(
        3, ge=0, text="time without another split or merge of a particle, in units of `every` steps"
    )


def bands(specs: list[LayerSpec], band: float) -> list[tuple[float, float]]:
    """Returns the depths [m] (top, bottom) of the band of each layer, in the order of `specs`.

    The finest layer has the uppermost band; the bottom of the coarsest is infinite. band: thickness
    of a band in supports.
    """
    order = sorted(range(len(specs)), key=lambda k: specs[k].mass)
    found, top = [(0.0, 0.0)] * len(specs), 0.0
    for k in order:
        bottom = top + band * specs[k].support
        found[k] = (top, bottom if k != order[-1] else float("inf"))
        top = bottom
    return found


def coarser_of(specs: list[LayerSpec]) -> list[int]:
    """Returns for each layer the layer that two of its particles merge into, or -1."""
    return [
        next((j for j, b in enumerate(specs) if abs(b.mass / a.mass - 2.0) < RATIO_TOLERANCE), -1)
        for a in specs
    ]


def finer_of(specs: list[LayerSpec]) -> list[int]:
    """Returns for each layer the layer that its particles split into, or -1."""
    coarser = coarser_of(specs)
    return [coarser.index(k) if k in coarser else -1 for k in range(len(specs))]


def with_exact_ratios(specs: list[LayerSpec]) -> list[LayerSpec]:
    """Returns layers with mass ratios near 2 set to 2: merges then conserve mass exactly."""
    found = list(specs)
    for k in sorted(range(len(specs)), key=lambda k: specs[k].mass):
        coarser = coarser_of(found)[k]
        if coarser >= 0:
            found[coarser] = replace(found[coarser], mass=2.0 * found[k].mass)
    return found


def farthest_depth(specs: list[LayerSpec], parameters: AdaptationParameters) -> float:
    """Returns the depth [m] below which all particles belong to the coarsest layer, hysteresis
    included."""
    tops = [top for top, _ in bands(specs, parameters.band)]
    return max(tops) * (1.0 + 2.0 * parameters.hysteresis)


def band_rows(specs: list[LayerSpec], parameters: AdaptationParameters) -> dict[str, np.ndarray]:
    """Returns the bands' columns of the table by layer: top and bottom [m], coarser and finer."""
    top, bottom = np.array(bands(specs, parameters.band)).T
    return {
        "top": top,
        "bottom": bottom,
        "coarser": np.array(coarser_of(specs)),
        "finer": np.array(finer_of(specs)),
    }
