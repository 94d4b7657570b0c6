"""One image field, drawn anew each frame: water by its mesh, or particles, in their pool."""

import numpy as np
import taichi as ti

from msph.fluid.world import World
from msph.picture.backdrop import Backdrop
from msph.picture.body_shading import BodyShading
from msph.picture.enlarger import Enlarger
from msph.picture.legend import LegendPanel
from msph.picture.look import Look
from msph.picture.particles_view import OwnRadius, ParticlesView
from msph.picture.pixels import Image, as_u8
from msph.picture.pool import Pool
from msph.picture.rasteriser import NOTHING, Rasteriser
from msph.picture.room import SMALLEST, PictureRoom, PixelFields
from msph.picture.shot import Lens, shoot
from msph.picture.sky import Sky
from msph.picture.sunlight import Light
from msph.picture.tone import Tone
from msph.picture.water import Water
from msph.surface import SurfaceRoom, surface_of
from msph.taichi_internals import data_oriented, kernel


def picture_of(world: World, surface_room: SurfaceRoom, room: PictureRoom) -> "Picture":
    """A picture of the surface, particles and bodies of a world, for World.once."""
    mesh = world.once(surface_of, surface_room).mesh
    return Picture(mesh, world.parts.boundary, room)


@data_oriented
class Picture:
    """Images of the water in a box, of any size that the room holds.

    mesh: the water's surface in box coordinates; fields `vertices` [m], `normals`, `triangles`,
    `counts` (vertices, triangles). boundary: the fluid's, whose bodies are drawn, or None.

    The constructor allocates all memory (see PixelFields); `load`, `change` and `resize` only set
    numbers, so no kernel is compiled twice. Kernels for bodies, particles, legends and fewer or
    more rays than pixels are compiled when they are first used.
    """

    def __init__(self, mesh, boundary=None, room=SMALLEST):
        self.mesh, self.boundary, self.room = mesh, boundary, room
        self.fields, self.lens, tone = PixelFields(room), Lens(), Tone()
        self.enlarger, self.legend = Enlarger(self.fields), LegendPanel(room.width, room.height)
        self.raster, self.light = Rasteriser(self.fields, self.lens), Light(mesh, self.lens)
        self.particles = ParticlesView(self.lens, self.raster, tone, self.fields.canvas)
        self.sky, self.bodies = Sky(), BodyShading(boundary)
        # The view of a pool without bodies, and of one with bodies.
        pools = Pool(self.sky), Pool(self.sky, self.bodies)
        backdrops = [Backdrop(self.fields, self.lens, pool, tone) for pool in pools]
        self.waters = [
            Water(mesh, self.lens, self.raster, self.light, backdrop, self.fields.canvas)
            for backdrop in backdrops
        ]
        self.radii = {}

    def load(self, width, height, box, look=None):
        """Draws images of width x height pixels of the box (Lx, Ly, Lz) [m] from now on, with the
        bodies that the boundary has now. Raises ValueError where the room does not hold them."""
        self.box = tuple(map(float, box))
        occupied = self.boundary is not None and self.boundary.count > 0
        if occupied:
            self.bodies.load(self.box)
        self.water = self.waters[occupied]
        self.change(look or Look())
        self.sky.paint(ti.math.vec3(*self.look.sun_direction()))
        self.resize(width, height)

    def resize(self, width, height):
        """Draws images of another size. Raises ValueError where the room does not hold them."""
        if not self.room.holds(width, height, self.rays):
            raise ValueError(f"{width}x{height} pixels of {self.rays} rays exceed {self.room}")
        self.width, self.height = self.size = width, height
        self.legend.resize(width, height)
        self.scale, self.seen = 1.0, None

    def change(self, look):
        """Another look that differs in live parameters only."""
        self.look, self.seen = look, None

    @property
    def backdrop(self):
        return self.water.backdrop

    @property
    def rays(self):
        """Rays per pixel along each axis."""
        return self.look.supersample

    @property
    def image(self):
        """The image last drawn."""
        direct = self.drawn == self.size
        return Image(self.fields.canvas if direct else self.fields.resolved, *self.size)

    @property
    def drawn(self):
        """Pixels (right, up) that rays are sent through: fewer than the image has where `scale` is
        below 1 and the look asks for one ray per pixel."""
        factor = self.rays if self.rays > 1 else self.scale
        return max(1, round(factor * self.width)), max(1, round(factor * self.height))

    def aim(self, camera, tilt):
        """Set the lens for this frame; returns whether the view changed."""
        state = None if tilt is None else np.asarray(tilt, float).tobytes()
        seen = (camera.state(), state, self.drawn)
        changed = seen != self.seen
        if changed:
            w, h = self.drawn
            self.lens.set(shoot(camera, tilt, self.box, w, h, self.look))
            self.seen = seen
        return changed

    def draw_water(self, camera, tilt=None):
        """The water's mesh in its pool; tilt: 3x3 rotation of the box about its centre."""
        changed = self.aim(camera, tilt)
        if self.look.caustics:
            self.light.shine()
        self.rasterise()
        self.backdrop.refresh(changed, flooded=True)
        self.water.shade()
        self.resolve()

    @kernel
    def rasterise(self):
        """The visibility buffer and the water's level."""
        self.raster.clear(self.mesh.counts[1])
        self.light.survey()
        self.raster.draw_mesh(self.mesh)

    def draw_particles(self, camera, tilt, x, value, lo, hi, n, radius, legend=None):
        """The first n particles at x [m], coloured by `value` from lo to hi.

        radius: a f32 field [m]; what has none is hidden. legend: a Legend to lay over the picture,
        where the look wants any.
        """
        self.backdrop.refresh(self.aim(camera, tilt))
        self.particles.draw(x, self.radius_of(radius), value, lo, hi, n, self.backdrop)
        self.resolve()
        if legend and self.look.legend:
            self.legend.draw(legend, self.image)

    def radius_of(self, radius):
        """One reader for each field: every new one would compile its kernels again."""
        if id(radius) not in self.radii:
            self.radii[id(radius)] = OwnRadius(radius)
        return self.radii[id(radius)]

    def resolve(self):
        """Average the rays of each pixel, or enlarge a picture of fewer pixels."""
        if self.rays > 1:
            self.average(self.rays, *self.size)
        elif self.drawn != self.size:
            self.enlarger.enlarge(*self.drawn, *self.size)

    @kernel
    def average(self, rays: ti.i32, width: ti.i32, height: ti.i32):
        for i, j in ti.ndrange(width, height):
            total = ti.math.vec3(0.0)
            for a, b in ti.ndrange(rays, rays):
                total += self.fields.canvas[i * rays + a, j * rays + b]
            self.fields.resolved[i, j] = total / rays**2

    def to_numpy_u8(self):
        """(height, width, 3) uint8, first row at the top."""
        return as_u8(self.image)

    def pick(self, i, j):
        """Box position [m] of the water last drawn under pixel (i right, j up), or None."""
        if not (0 <= i < self.width and 0 <= j < self.height):
            return None
        i, j = (int(p * n / m) for p, n, m in zip((i, j), self.drawn, self.size, strict=True))
        key = self.raster.key[i, j]
        if self.seen is None or key == NOTHING:
            return None
        corners = self.mesh.triangles[key & ((1 << self.raster.item_bits[None]) - 1)]
        a, b, c = (np.asarray(self.mesh.vertices[k], float) for k in corners)
        shot = self.lens.numbers
        d = shot["origin"] + i * shot["du"] + j * shot["dv"]
        n = np.cross(b - a, c - a)
        slope = np.dot(d, n)
        return shot["eye"] + d * np.dot(a - shot["eye"], n) / slope if slope else None
