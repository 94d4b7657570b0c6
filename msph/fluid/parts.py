"""Components of the fluid that all methods share."""

from msph.fluid.boundary.beach import Beaches
from msph.fluid.boundary.body_links import BodyLinks
from msph.fluid.boundary.boundary import Boundary
from msph.fluid.boundary.collisions import Collisions
from msph.fluid.boundary.contact import Contact
from msph.fluid.boundary.gap_pressure import GapPressure
from msph.fluid.boundary.openings import Openings
from msph.fluid.boundary.rim import Rim
from msph.fluid.boundary.walls import Walls
from msph.fluid.constants import Constants
from msph.fluid.impulse_ledger import ImpulseLedger
from msph.fluid.particles.grid import LayeredGrid
from msph.fluid.particles.images import Images
from msph.fluid.particles.layers import Layers
from msph.fluid.particles.neighbour_list import NeighbourList
from msph.fluid.particles.particles import Attribute, Particles
from msph.fluid.particles.removal import Removal
from msph.fluid.room import Room


class Parts:
    """Fields of one capacity, and the objects whose kernels maintain them. Each part has those
    before it as attributes of the same names."""

    def __init__(self, room: Room, attributes: tuple[Attribute, ...]):
        self.room, self.constants, self.layers = room, Constants(), Layers()
        self.walls = Walls(self.constants)
        self.apertures = self.walls.apertures
        self.particles = Particles(room.particles, attributes)
        self.grid = LayeredGrid(room, self.constants, self.layers, self.particles)
        self.boundary = Boundary(room, self.constants, self.layers)
        self.impulses = ImpulseLedger()
        self.removal, self.contact = Removal(self), Contact(self)
        self.neighbours = NeighbourList(room, self.grid)
        self.links = BodyLinks(self)
        self.images = Images(self)
        self.collisions, self.gaps = Collisions(self), GapPressure(self)
        self.openings, self.rim = Openings(self), Rim(self)
        self.beaches = Beaches(self)
