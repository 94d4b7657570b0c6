"""Renderer: draws the water surface or the particles in the pool into one image field."""

import math
from functools import partial

import numpy as np
import taichi as ti

from msph.fluid.boundary.rim import Rim
from msph.launches import Traits, data_oriented, kernel, use_traits
from msph.picture.backdrop import Backdrop
from msph.picture.body_faces import BodyFaces
from msph.picture.body_shading import BodyShading
from msph.picture.droplets_view import DropletSums, DropletsView
from msph.picture.edge_filter import EdgeFilter
from msph.picture.enlarger import Enlarger
from msph.picture.hand_view import HandView
from msph.picture.legend import LegendPanel
from msph.picture.look import Look
from msph.picture.particles_view import ParticlesView
from msph.picture.pixels import Image, as_u8, colour_of
from msph.picture.pool import Pool
from msph.picture.rasteriser import NO_ITEM, Rasteriser
from msph.picture.ripples import Ripples
from msph.picture.room import SMALLEST, PictureRoom, PixelFields
from msph.picture.shadows import Shadows
from msph.picture.shot import Lens, ray, shot_numbers
from msph.picture.sky import Sky
from msph.picture.sunlight import Sunlight
from msph.picture.tone import Tone
from msph.picture.water import WaterShader
from msph.picture.wetness import EVERY, LOST, Wetness
from msph.state import State
from msph.surface import SurfaceRoom, surface_of
from msph.surface.thin_water import ThinWater
from msph.surface.whitewater import Whitewater, whitewater_of


def picture_of(state: State, surface_room: SurfaceRoom, room: PictureRoom) -> "Picture":
    """Builds a picture of the surface, particles and bodies of a state (for State.build_once)."""
    surface, white = state.build_once(surface_of, surface_room), state.build_once(whitewater_of)
    return Picture(surface.mesh, state.boundary, room, white, state.rim, surface.thin)


@data_oriented
class Picture:
    """Renderer for images of the water in a box, of any size that the room holds.

    mesh: water surface in box coordinates, with the fields `vertices` [m], `normals`, `triangles`
    and `counts` (vertices, triangles). boundary: the fluid's boundary, whose bodies are drawn, or
    None. whitewater: drawn if the look shows it. rim: its drops are drawn. thin: its spray is
    drawn, and makes ripples if the look shows them. Each may be None.

    The constructor allocates all memory; `load`, `change` and `resize` only set numbers, so no
    kernel is compiled twice. Kernels for bodies, particles, legends, supersampling (one for each
    number of rays) and upscaling are compiled when they are first used.
    """

    def __init__(
        self,
        mesh,
        boundary=None,
        room=SMALLEST,
        whitewater: Whitewater | None = None,
        rim: Rim | None = None,
        thin: ThinWater | None = None,
    ):
        self.mesh, self.boundary, self.room = mesh, boundary, room
        self.drying = EVERY  # simulated time since the last decay of the wetness [s]
        self.pure = False  # True if the last image is of water without a ball
        # Loops over pixels run in parallel in any scene; load() sets if there are bodies.
        self.traits = Traits()
        with use_traits(self.traits):
            self._build(whitewater, rim, thin)
        # Centre [m] in the box frame and radius [m] of a ball that images show, or None.
        self.ball: tuple[tuple[float, float, float], float] | None = None

    def _build(self, whitewater: Whitewater | None, rim: Rim | None, thin: ThinWater | None):
        mesh, boundary, room = self.mesh, self.boundary, self.room
        self.fields, self.lens, tone = PixelFields(room), Lens(), Tone()
        self.edge_filter, self.enlarger = EdgeFilter(self.fields), Enlarger(self.fields)
        self.legend = LegendPanel(room.width, room.height)
        self.raster, self.sunlight = Rasteriser(self.fields, self.lens), Sunlight(mesh, self.lens)
        self.particles = ParticlesView(self.lens, self.raster, tone, self.fields.canvas)
        self.sky, self.bodies = Sky(), BodyShading(boundary)
        self.faces = BodyFaces(boundary, self.fields, self.lens, self.raster)
        pool = Pool(self.sky, self.bodies, Shadows(self.faces, self.lens))
        self.wetness = Wetness(mesh)
        self.ripples = Ripples(thin, self.sunlight, self.lens) if thin else None
        self.backdrop = Backdrop(self.fields, self.lens, pool, tone, self.wetness, self.faces)
        water = mesh, self.lens, self.raster, self.sunlight, self.ripples, self.backdrop
        self.shader = WaterShader(*water, self.fields.canvas, self.fields.samples)
        self.droplets: DropletsView | None = None
        if thin and rim and whitewater:
            drops = thin.spray, rim, whitewater, self.shader
            self.droplets = DropletsView(*drops, DropletSums(room), self.fields.canvas)
        self.hand_view = HandView(self.lens, self.raster, self.fields.canvas)

    def load(self, width, height, box, look=None, region=None, spacing=0.0):
        """Prepares images of width x height pixels of the box (Lx, Ly, Lz) [m] with the boundary's
        present bodies. region [m]: extent of the water's surface, higher than a box without a lid;
        spacing [m]: largest distance between vertices of the mesh. Raises ValueError if the room
        does not hold them."""
        self.box, self.spacing = tuple(map(float, box)), spacing
        self.wetness.load(self.box, spacing)
        self.region = tuple(map(float, region or box))
        self.take_bodies(self.boundary is not None and self.boundary.count > 0)
        self.change(look or Look())
        self.reset()
        self.sky.paint(ti.math.vec3(*self.look.sun_direction()))
        self.resize(width, height)

    def take_bodies(self, occupied):
        """Prepares images of the boundary's present bodies, by kernels for bodies if `occupied`;
        wet places stay wet."""
        self.traits.bodies = self.backdrop.occupied = occupied
        if occupied:
            self.bodies.load(self.box)
            self.faces.load()
        self.view = None  # the shader's image without water may be of other bodies

    def resize(self, width, height):
        """Changes the size of images. Raises ValueError if the room does not hold them."""
        if not self.room.holds(width, height, self.rays):
            raise ValueError(f"{width}x{height} pixels of {self.rays} rays exceed {self.room}")
        self.width, self.height = self.size = width, height
        self.legend.resize(width, height)
        self.scale, self.view, self.ball = 1.0, None, None
        self.backdrop.forget()

    def change(self, look):
        """Sets another look that differs in live parameters only."""
        self.look, self.view = look, None

    def reset(self):
        """Dries walls and bodies, and smooths the surface."""
        self.wetness.reset()
        self.drying = EVERY  # the first image compiles the decay
        self.begun = False  # True from the first image on
        self.view = None  # the image without water shows the wet walls
        if self.ripples:
            self.ripples.reset()

    def advance(self, dt, hand):
        """Advances wetness and ripples by dt [s] of simulated time; hand: the user's Hand."""
        self.drying += dt
        if self.look.ripples and self.ripples and self.begun:
            self.ripples.advance(dt, hand, max(self.box))

    def dry(self):
        """Updates the wetness. Returns True if the image without water changes."""
        due = self.drying >= EVERY
        if due:
            self.wetness.decay(math.exp(-LOST * self.drying / self.look.drying))
            self.drying = 0.0
        self.wetness.mark()
        return due and self.wetness.renew() > 0

    @property
    def rays(self):
        """Rays per pixel along each axis."""
        return self.look.supersample

    @property
    def image(self):
        """The last image."""
        return Image(self.fields.resolved, *self.size)

    @property
    def ray_counts(self):
        """Number of rays (right, up), fewer than pixels if `scale` is below 1 and the look has one
        ray per pixel."""
        factor = self.rays if self.rays > 1 else self.scale
        return max(1, round(factor * self.width)), max(1, round(factor * self.height))

    def view_of(self, camera, tilt):
        """Returns all values that the view of an image depends on."""
        state = None if tilt is None else np.asarray(tilt, float).tobytes()
        return camera.state(), state, self.ray_counts

    def set_view(self, camera, tilt, whole=False):
        """Sets the view of this frame; whole: items may be anywhere in the image, not only in the
        box. Returns True if it changed."""
        view = (self.view_of(camera, tilt), whole)
        changed = view != self.view
        if changed:
            w, h = self.ray_counts
            surface = self.region, self.spacing
            numbers = shot_numbers(camera, tilt, self.box, w, h, self.look, *surface)
            self.lens.set(numbers, whole)
            self.view, self.begun = view, True
        return changed

    def draw_water(self, camera, tilt=None, spray=True):
        """Renders the water surface in its pool; tilt: 3x3 rotation of the box about its centre;
        spray: the mesh lacks the spray."""
        changed = self.set_view(camera, tilt)
        if self.look.caustics:
            self.sunlight.trace_caustics()
        dried = self.look.drying > 0.0 and self.dry()
        self.backdrop.take(changed)
        self.rasterise(self.backdrop.occupied and self.boundary.container is not None)
        self.backdrop.refresh(True, dried)
        self.shader.shade()
        if self.droplets:
            white, spilt = self.look.whitewater, self.droplets.rim.has_drops
            self.droplets.show(bool(white), spilt, spray)
        self.pure = not self.ball
        self.resolve(False)

    def repeat(self, camera, tilt):
        """Draws the last image again, without panels, if it shows water in this view and no ball.
        Returns True, or False if a new image is needed."""
        same = self.pure and not self.ball and self.view == (self.view_of(camera, tilt), False)
        if same:
            self.resolve(False)
        return same

    @kernel
    def rasterise(self, contained: ti.i32):
        """Fills the visibility buffer and the map of water levels. contained: 1 for a container."""
        self.raster.clear(self.mesh.counts[1])
        self.sunlight.update_levels()
        self.raster.draw_mesh(self.mesh, contained)
        self.raster.mark_wet(contained)

    def draw_particles(self, camera, tilt, x, value, lo, hi, n, radius, legend=None):
        """Renders the first n particles at x [m], coloured by `value` from lo to hi. radius: f32
        field [m]; particles of radius 0 are hidden. legend: drawn if the look shows legends."""
        self.backdrop.take(self.set_view(camera, tilt, whole=True))
        self.backdrop.refresh()
        self.particles.draw(x, radius, value, lo, hi, n, self.backdrop)
        self.resolve(True)
        if legend and self.look.legend:
            self.legend.draw(legend, self.image)

    def resolve(self, whole):
        """Draws the ball; averages the rays of each pixel, or smooths the edges of an image with
        one ray or fewer per pixel and upscales the image. whole: see EdgeFilter.smooth."""
        if self.ball:
            self.hand_view.draw(*self.ball)
        if self.rays > 1:
            self.average(self.rays, *self.size)
        else:
            self.edge_filter.smooth(*self.ray_counts, whole)
            if self.ray_counts != self.size:
                self.enlarger.enlarge(*self.ray_counts, *self.size)

    def later_kernels(self):
        """Returns functions that compile kernels which the first images do not need, by drawing on
        the last image without effect on the next."""
        found = [partial(self.droplets.draw, 0, 0, 0)] if self.droplets else []
        if self.ripples and self.look.ripples:
            found.append(self.ripples.compile)
        found.append(lambda: self.hand_view.draw(ti.math.vec3(0.0), 0.0))
        if self.rays == 1:
            found.append(lambda: self.enlarger.enlarge(*self.ray_counts, *self.size))
        return found

    @kernel
    def average(self, rays: ti.template(), width: ti.i32, height: ti.i32):
        for i, j in ti.ndrange(width, height):
            total = ti.math.vec3(0.0)
            for a, b in ti.static(ti.ndrange(rays, rays)):
                total += colour_of(self.fields.canvas[i * rays + a, j * rays + b])
            self.fields.resolved[i, j] = total / rays**2

    def to_numpy_u8(self):
        """Returns the image (height, width, 3) uint8, first row at the top."""
        return as_u8(self.image)

    def pick(self, i, j):
        """Returns the point [m] on the last surface drawn at pixel (i right, j up), or None."""
        if not (0 <= i < self.width and 0 <= j < self.height):
            return None
        i, j = (int(p * n / m) for p, n, m in zip((i, j), self.ray_counts, self.size, strict=True))
        if self.view is None:
            return None
        *point, found = self.find_point(i, j)
        return np.array(point) if found else None

    @kernel
    def find_point(self, i: ti.i32, j: ti.i32) -> ti.math.vec4:
        """Returns the point [m] of the surface at ray (i, j), and 1, or 0 without a triangle."""
        shot, found = self.lens.shot[None], ti.math.vec4(0.0)
        if self.raster.key[i, j] != NO_ITEM and self.raster.item(i, j) != self.raster.wet[None]:
            d = ray(i, j, shot)
            depth, flat, _ = self.shader.hit_surface(i, j, d, shot)
            if d.dot(flat) != 0.0:
                found = ti.math.vec4(shot.eye + d * depth, 1.0)
        return found
