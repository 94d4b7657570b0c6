"""Worlds: the fields of a fluid, allocated once and refilled for each scene.

Taichi compiles a kernel for the fields it uses. Simulations take worlds from a stock and return
them when closed, so that the next simulation reuses the compiled kernels.
"""

import gc
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import numpy as np

from msph.fluid.boundary.opening import Opening
from msph.fluid.boundary.walls import wall_constants
from msph.fluid.methods import all_attributes
from msph.fluid.parts import Parts
from msph.fluid.plan import Plan
from msph.fluid.room import Room, room_for
from msph.launches import Traits, use_traits
from msph.taichi_internals import field_trees

# Taichi crashes beyond MAX_TREES field trees per process; a world with its surface and image takes
# at most WORLD_TREES.
MAX_TREES, WORLD_TREES = 512, 24

# Estimated ratio of the particles after the first adaptation to those before it (-), which decides
# between serial and parallel loops. It is 1.8 to 9 in the shipped scenes, mostly 2 to 4.
GROWTH = 3

T = TypeVar("T")


class Builder:
    """Owner of fields on which objects with kernels are built once. traits: of these objects."""

    traits: Traits
    _built: dict[Any, Any]

    def build_once(self, build: Callable[..., T], *arguments: Any) -> T:
        """Returns build(self, *arguments); later calls with the same arguments return the same
        object, so that its kernels are compiled once."""
        key = build, *arguments
        if key not in self._built:
            with use_traits(self.traits):
                self._built[key] = build(self, *arguments)
        return self._built[key]


class World(Builder):
    """Components of a fluid with capacity `room`, and all objects with kernels on them."""

    def __init__(self, room: Room):
        taken = field_trees()
        if taken > MAX_TREES - WORLD_TREES:
            raise RuntimeError(
                f"{taken} of {MAX_TREES} Taichi field trees are in use: "
                "no room for another simulation in this process"
            )
        self.traits = Traits()
        with use_traits(self.traits):
            self.parts = Parts(room, all_attributes())
        self._built = {}

    def load(self, plan: Plan) -> Any:
        """Fills tables and constants for a scene; returns the solver of its method."""
        parts, specs = self.parts, plan.specs
        growth = GROWTH if plan.adaptation else 1
        self.traits.particles = growth * len(plan.initial["x"])
        parts.constants.fill(**plan.constants())
        parts.layers.load(specs, *plan.tables())
        attributes = plan.method.attributes(plan.parameters, plan.adaptation is not None)
        parts.particles.load(attributes, plan.max_particles)
        margin = plan.method.LIST_MARGIN * plan.finest.support
        parts.neighbours.load(plan.entries, margin)
        self.load_bodies(plan)
        parts.beaches.load(plan.beaches)
        solver = self.build_once(_solver, plan.method)
        solver.load(plan.parameters, plan.adaptation)
        return solver

    def load_bodies(self, plan: Plan) -> None:
        """Fills the boundary with the bodies of a scene."""
        self.parts.boundary.load(plan.size, plan.specs, list(plan.bodies), plan.open_top)
        self.prepare_bodies()

    def load_openings(self, plan: Plan, openings: Sequence[Opening]) -> None:
        """Replaces the openings of a scene."""
        walls = np.array(wall_constants(plan.size, plan.open_top)["walls"])
        self.parts.openings.load(openings, walls)
        self.parts.rim.load(plan.open_top or bool(openings))

    def prepare_bodies(self) -> None:
        """Prepares links, contacts and gaps for the present bodies."""
        parts = self.parts
        self.traits.bodies = parts.boundary.count > 0
        for part in (parts.links, parts.contact, parts.collisions, parts.gaps):
            part.load()
        if parts.boundary.driven:
            # Compiled here, so that the first check for trapped water does not wait.
            parts.boundary.nearest_moving(np.zeros(3))
            for name in ("x", "density", "layer"):
                parts.particles.numpy(name)


def _solver(world: World, method: Any) -> Any:
    return method(world.parts)


# Unused worlds, the most recently used first, which has the most compiled kernels.
_stock: list[World] = []


def take(needed: Room) -> World:
    """Returns a world for exclusive use until give_back(); RuntimeError if Taichi has no room."""
    found = _smallest(needed)
    if found is None and gc.collect():
        # A simulation dropped without close() may have held a world until it was collected.
        found = _smallest(needed)
    if found is None:
        return World(room_for(needed))
    _stock.remove(found)
    return found


def take_again(world: World) -> None:
    """Takes a certain world from the stock."""
    _stock.remove(world)


def give_back(world: World) -> None:
    """Returns a world to the stock."""
    _stock.insert(0, world)


def _smallest(needed: Room) -> World | None:
    """Returns the smallest sufficient world of the stock, or None."""
    held = [w for w in _stock if w.parts.room.holds(needed)]
    return min(held, key=lambda w: w.parts.room.entries, default=None)
