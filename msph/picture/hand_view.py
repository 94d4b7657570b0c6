"""Drawing of the user's hand as a translucent ball over the image."""

import taichi as ti

from msph.launches import data_oriented, kernel
from msph.picture.pixels import colour_of, word
from msph.picture.rasteriser import Rasteriser, sphere_inverse_depth
from msph.picture.shot import ray

vec3 = ti.math.vec3

# Display-referred colours of the ball and its highlight.
SKIN, LIGHT = (1.0, 0.93, 0.72), (1.0, 1.0, 0.96)
# Opacity in the middle, opacity added by the outline, and factor of the opacity below the centre,
# where water covers the ball.
MIDDLE, OUTLINE, SUNKEN = 0.12, 0.6, 0.45
# Powers of the outline and of the highlight; share of the radius over which the edge fades.
OUTLINE_POWER, GLOSS, EDGE = 3.0, 40.0, 0.03
GLINT = 0.8  # opacity of the highlight


@data_oriented
class HandView:
    """Draws a ball into the field `image` of words, one per ray."""

    def __init__(self, lens, raster: Rasteriser, image):
        self.lens, self.raster, self.image = lens, raster, image

    @kernel
    def draw(self, centre: vec3, radius: ti.f32):
        """Blends a ball with a centre [m], box frame, and a radius [m] over the image."""
        c = centre - self.lens.shot[None].eye
        box = self.raster.around(c, radius, 0.0, self.lens.shot[None])
        for i, j in ti.ndrange((box[0], box[2] + 1), (box[1], box[3] + 1)):
            shot = self.lens.shot[None]
            d = ray(i, j, shot).normalized()
            per_way = sphere_inverse_depth(c, radius, d)
            if per_way > 0.0:
                n = (d / per_way - c) / radius
                inward = -n.dot(d)  # cosine between ray and normal
                edge = ti.min((1.0 - ti.sqrt(ti.max(1.0 - inward * inward, 0.0))) / EDGE, 1.0)
                opacity = MIDDLE + OUTLINE * (1.0 - inward) ** OUTLINE_POWER
                opacity *= edge * ti.select(n.dot(shot.up) > 0.0, 1.0, SUNKEN)
                half = (shot.sun - d).normalized()
                glint = edge * ti.max(n.dot(half), 0.0) ** GLOSS
                colour = ti.math.mix(colour_of(self.image[i, j]), vec3(SKIN), opacity)
                self.image[i, j] = word(ti.math.mix(colour, vec3(LIGHT), GLINT * glint))
