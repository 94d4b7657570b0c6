"""Plan: everything that a simulation reads from a scene, computed once."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from msph.fluid.adaptivity.bands import AdaptationParameters, farthest_depth
from msph.fluid.adaptivity.surface_distance import depth_constants
from msph.fluid.boundary.beach import Beach
from msph.fluid.boundary.boundary import Boundary
from msph.fluid.boundary.contact import LEAK
from msph.fluid.boundary.mesh_samples import sample_count
from msph.fluid.boundary.opening import Opening
from msph.fluid.boundary.rigid_bodies import Body
from msph.fluid.boundary.walls import region, wall_constants
from msph.fluid.methods import Parameters, solver_of
from msph.fluid.particles.grid import cells_of, grid_rows
from msph.fluid.particles.images import image_capacity
from msph.fluid.particles.layers import LayerSpec
from msph.fluid.particles.neighbour_list import (
    list_capacity,
    list_tables,
    max_mean_neighbours,
)
from msph.fluid.room import Room


@dataclass(frozen=True, eq=False)
class Plan:
    """Input of a Simulation.

    size: of the box [m]. specs: the layers. initial: attributes of the initial particles by name: x
    and v (n, 3) [m, m/s], layer (n,). parameters: of the method. bodies: in the box, containers
    included. adaptation: None if particles keep their layer. capacity: largest number of particles,
    by default the initial number. restitution: share of speed kept at walls (-). open_top:
    the box has no lid, and water that leaves it is removed. openings: inflows and outflows.
    beaches: zones that damp waves.
    """

    size: tuple[float, float, float]
    specs: list[LayerSpec]
    initial: dict[str, np.ndarray]
    parameters: Parameters
    bodies: Sequence[Body] = ()
    adaptation: AdaptationParameters | None = None
    capacity: int | None = None
    restitution: float = 0.0
    open_top: bool = False
    openings: Sequence[Opening] = ()
    beaches: Sequence[Beach] = ()

    @cached_property
    def region(self) -> tuple[float, float, float]:
        """Extent [m] of grids and surface: the box, and room above an open top."""
        return region(self.size, self.open_top)

    @cached_property
    def method(self) -> Any:
        """Solver class."""
        return solver_of(self.parameters)

    @cached_property
    def max_particles(self) -> int:
        """Largest number of particles."""
        return max(self.capacity or 0, len(self.initial["x"]))

    @cached_property
    def finest(self) -> LayerSpec:
        return min(self.specs, key=lambda s: s.mass)

    @cached_property
    def list_form(self) -> str:
        """Form of the neighbour list, a key of LIST_FORMS."""
        return self.method.list_form(self.parameters)

    @cached_property
    def entries(self) -> int:
        """Largest number of entries of the neighbour list."""
        margin = self.method.LIST_MARGIN
        return list_capacity(self.specs, margin, self.list_form, self.max_particles)

    @cached_property
    def _depth(self) -> dict[str, Any]:
        """Constants of the depth grid; empty without adaptation."""
        if self.adaptation is None:
            return {}
        return depth_constants(
            self.region, self.finest, farthest_depth(self.specs, self.adaptation)
        )

    @cached_property
    def needed(self) -> Room:
        """Capacity that the simulation needs."""
        return Room(
            particles=self.max_particles,
            entries=self.entries,
            cells=sum(cells_of(self.region, self.specs)),
            depth_cells=int(np.prod(self._depth.get("depth_dims", 0))),
            samples=sample_count(list(self.bodies), self.specs),
            images=self._images,
        )

    @property
    def _images(self) -> int:
        """Number of places for images; methods without bodies have no images in walls either."""
        if not self.method.HAS_BODIES:
            return 0
        return image_capacity(self.region, self.specs, self.max_particles, bool(self.bodies))

    def constants(self) -> dict[str, Any]:
        """Returns the scene's constants by their names in Constants."""
        margin = self.method.LIST_MARGIN
        return {
            **wall_constants(self.size, self.open_top),
            "layers": len(self.specs),
            "finest_spacing": self.finest.spacing,
            "leak": LEAK * self.finest.spacing,
            "rest_density": self.specs[0].density,
            "restitution": self.restitution,
            "cells": self.needed.cells,
            "entries": self.entries,
            "mean_neighbours": max_mean_neighbours(self.specs, margin, self.list_form),
            **self._depth,
            **self.method.constants_of(self.parameters, self.adaptation, self.specs),
        }

    def tables(self) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
        """Returns further columns of the tables by layer and by pair of layers (layers.py)."""
        rows, pairs = list_tables(self.specs, self.method.LIST_MARGIN, self.list_form)
        own_rows, own_pairs = self.method.tables_of(self.adaptation, self.specs)
        rows |= own_rows | grid_rows(self.region, self.specs) | Boundary.layer_rows(self.specs)
        return rows, pairs | own_pairs
