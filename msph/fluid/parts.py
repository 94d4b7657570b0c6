"""Components of the fluid that all methods share."""

from dataclasses import dataclass

from msph.fluid.boundary.beach import Beaches
from msph.fluid.boundary.body_links import BodyLinks
from msph.fluid.boundary.boundary import Boundary
from msph.fluid.boundary.collisions import Collisions
from msph.fluid.boundary.contact import Contact
from msph.fluid.boundary.gap_pressure import GapPressure
from msph.fluid.boundary.openings import Openings
from msph.fluid.boundary.rim import Rim
from msph.fluid.constants import Constants
from msph.fluid.impulse_ledger import ImpulseLedger
from msph.fluid.particles.grid import LayeredGrid
from msph.fluid.particles.images import Images
from msph.fluid.particles.layers import Layers
from msph.fluid.particles.neighbour_list import NeighbourList
from msph.fluid.particles.particles import Particles
from msph.fluid.particles.removal import Removal
from msph.fluid.room import Room


@dataclass(frozen=True, eq=False)
class Parts:
    """Fields of one capacity, and the objects whose kernels maintain them."""

    room: Room
    constants: Constants
    layers: Layers
    particles: Particles
    removal: Removal
    grid: LayeredGrid
    neighbours: NeighbourList
    boundary: Boundary
    links: BodyLinks
    images: Images
    contact: Contact
    collisions: Collisions
    gaps: GapPressure
    openings: Openings
    rim: Rim
    beaches: Beaches
    impulses: ImpulseLedger
