"""One image field, drawn anew each frame: water by its mesh, or particles, in their pool."""

import numpy as np
import taichi as ti

from msph.picture.backdrop import Backdrop
from msph.picture.body_shading import BodyShading
from msph.picture.enlarger import Enlarger
from msph.picture.legend import LegendPanel
from msph.picture.look import Look
from msph.picture.particles_view import OwnRadius, ParticlesView
from msph.picture.pixels import as_u8
from msph.picture.pool import Pool
from msph.picture.rasteriser import NOTHING, Rasteriser
from msph.picture.shot import Lens, shoot
from msph.picture.sky import Sky
from msph.picture.sunlight import Light
from msph.picture.tone import Tone
from msph.picture.water import Water
from msph.taichi_internals import data_oriented, kernel

SKIN = 2e-3  # how near to a wall a face counts as lying on it, as a share of the longest edge


@data_oriented
class Picture:
    """Pictures of width x height pixels of the box (Lx, Ly, Lz) [m].

    mesh: the water's surface in box coordinates; fields `vertices` [m], `normals`, `triangles`,
    `counts` (vertices, triangles). particles: capacity of the particle view, 0 for none. boundary:
    the fluid's, where bodies are to be drawn, else None.
    scalable: whether `scale` may be set below 1: fewer pixels are drawn then, and enlarged; a
    picture that is supersampled keeps its scale.
    `image`: 3-vec f32 (width, height), 0..1 display-referred, index [right, up].
    """

    def __init__(
        self, width, height, box, mesh, look=None, particles=0, boundary=None, scalable=False
    ):
        self.width, self.height, self.mesh = width, height, mesh
        self.size = width, height
        self.box = tuple(map(float, box))
        self.look = look or Look()
        self.rays = self.look.supersample
        self.skin = SKIN * max(self.box)
        w, h = width * self.rays, height * self.rays
        self.canvas = ti.Vector.field(3, ti.f32, (w, h))
        self.mean = ti.Vector.field(3, ti.f32, (width, height)) if self.rays > 1 else None
        self.enlarger = None
        if scalable and self.rays == 1:
            self.enlarger = Enlarger(self.canvas, width, height)
        self.scale = 1.0
        self.lens = lens = Lens()
        bodies = BodyShading(boundary) if boundary is not None and boundary.count else None
        tone, pool = Tone(), Pool(Sky(self.look.sun_direction()), bodies)
        self.raster = Rasteriser(w, h, mesh.triangles.shape[0], lens, thickness=True)
        self.backdrop = Backdrop(w, h, lens, pool, tone, self.raster)
        self.light = Light(mesh, lens, self.box, self.look.caustics, self.look.caustic_cells)
        self.water = Water(
            mesh, lens, self.raster, pool, self.light, self.backdrop, tone, self.canvas
        )
        self.particles = None
        if particles:
            self.particles = ParticlesView(w, h, particles, lens, self.backdrop, tone)
        self.legend = LegendPanel(width, height) if particles and self.look.legend else None
        self.radii = {}
        self.seen = None

    @property
    def image(self):
        """The field that holds the picture last drawn."""
        if self.mean is not None:
            return self.mean
        return self.enlarger.image if self.drawn != (self.width, self.height) else self.canvas

    @property
    def drawn(self):
        """Pixels (right, up) that rays are sent through."""
        factor = self.scale if self.enlarger else self.rays
        return max(1, round(factor * self.width)), max(1, round(factor * self.height))

    def change(self, look):
        """Another look, as far as it may change while the picture is seen: its live parameters."""
        self.look, self.seen = look, None

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
        self.rasterise()
        self.backdrop.refresh(changed, flooded=True)
        self.shade()
        self.resolve()

    @kernel
    def rasterise(self):
        """The visibility buffer and the light, each pass a row of parallel loops."""
        self.raster.clear()
        self.light.cast(self.skin)
        self.raster.draw_mesh(self.mesh, self.skin)

    @kernel
    def shade(self):
        self.water.shade(self.skin)

    def draw_particles(self, camera, tilt, x, value, lo, hi, n, radius, legend=None):
        """The first n particles at x [m], coloured by `value` from lo to hi.

        radius: a f32 field [m]; what has none is hidden. legend: a Legend to lay over the picture,
        where the look wants any.
        """
        self.backdrop.refresh(self.aim(camera, tilt))
        self.particles.draw(x, self.radius_of(radius), value, lo, hi, n, self.canvas)
        self.resolve()
        if legend and self.legend:
            self.legend.draw(legend, self.image)

    def radius_of(self, radius):
        """One reader for each field: every new one would compile its kernels again."""
        if id(radius) not in self.radii:
            self.radii[id(radius)] = OwnRadius(radius)
        return self.radii[id(radius)]

    def resolve(self):
        """Average the rays of each pixel, or enlarge a picture of fewer pixels."""
        if self.rays > 1:
            self.average()
        elif self.image is not self.canvas:
            self.enlarger.enlarge(*self.drawn)

    @kernel
    def average(self):
        for i, j in self.mean:
            total = ti.math.vec3(0.0)
            for a, b in ti.ndrange(self.rays, self.rays):
                total += self.canvas[i * self.rays + a, j * self.rays + b]
            self.mean[i, j] = total / self.rays**2

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
        corners = self.mesh.triangles[key & self.raster.item_mask]
        a, b, c = (np.asarray(self.mesh.vertices[k], float) for k in corners)
        shot = self.lens.numbers
        d = shot["origin"] + i * shot["du"] + j * shot["dv"]
        n = np.cross(b - a, c - a)
        slope = np.dot(d, n)
        return shot["eye"] + d * np.dot(a - shot["eye"], n) / slope if slope else None
