"""Gaps between two bodies or a body and a wall, and the forces of particles in them.

No particles fit into a gap narrower than about a spacing, and those at its rim press too little on
the sides (gap_pressure.py). Their contact impulses in gaps are summed here, to
be replaced in the next step.
"""

import taichi as ti

from msph.fluid.boundary.boundary import Boundary
from msph.fluid.boundary.walls import NO_WALL, WALL
from msph.fluid.room import MAX_BODIES
from msph.launches import data_oriented, kernel

vec3 = ti.math.vec3

# Gap widths [finest spacings]: the pressure is extrapolated in full below NARROW, not above WIDE.
NARROW, WIDE = 1.2, 1.6
# Negative cosine between the normals of the two sides of a gap above which the sides face each
# other; below 0 they do not.
FACING = 0.5


@data_oriented
class Gaps:
    """Contact impulses of particles in gaps. active: 1 if there are gaps. push [N s], twist
    [N m s], by body: sums since clear(), with the opposite impulses on floating bodies opposite."""

    def __init__(self, boundary: Boundary):
        self.boundary, self.constants = boundary, boundary.constants
        self.active = ti.field(ti.i32, shape=())
        self.push, self.twist = (ti.Vector.field(3, ti.f32, shape=MAX_BODIES) for _ in range(2))

    @kernel
    def clear(self):
        """Sets the sums to zero."""
        for b in range(MAX_BODIES):
            self.push[b], self.twist[b] = vec3(0.0), vec3(0.0)

    @ti.func
    def side(self, b, x, away, pose):
        """Returns the share (-) of a gap at x [m] that is extrapolated, and the body on the other
        side, or WALL; away: unit normal of body b and distance from it [m] at x."""
        spacing, best, other = self.constants.finest_spacing[None], 0.0, WALL
        normal, own = away.yzw, ti.max(away.x, 0.0)
        walls = self.constants.walls[None]
        for axis in ti.static(range(3)):
            best = ti.max(best, self._share((x[axis] + own) / spacing, -normal[axis]))
            if walls[axis] < NO_WALL:
                width = (walls[axis] - x[axis] + own) / spacing
                best = ti.max(best, self._share(width, normal[axis]))
        for a in range(self.constants.bodies[None]):
            if a != b and self.boundary.reaches(a, x, WIDE * spacing, pose):
                near = self.boundary.distance(a, x, pose)
                share = self._share((near.x + own) / spacing, -normal.dot(near.yzw))
                if share > best:
                    best, other = share, a
        return best, other

    @ti.func
    def _share(self, width, facing):
        narrow = ti.math.clamp((WIDE - width) / (WIDE - NARROW), 0.0, 1.0)
        return narrow * ti.math.clamp(facing / FACING, 0.0, 1.0)

    @ti.func
    def half(self, other):
        """Returns the part (-) of a gap's impulses for this side: half if `other` floats."""
        return ti.select(self.is_floating(other), 0.5, 1.0)

    @ti.func
    def is_floating(self, other):
        found = False
        if other != WALL:
            found = self.boundary.inverse_mass[other] > 0.0
        return found

    @ti.func
    def record(self, b, x, away, impulse, pose):
        """Adds the part in gaps of a contact impulse [N s] on body b at x [m]; away as in
        side()."""
        if self.active[None] == 1:
            share, other = self.side(b, x, away, pose)
            part = share * self.half(other) * impulse
            self.push[b] += part
            self.twist[b] += (x - self.boundary.centre[b, pose]).cross(part)
            if self.is_floating(other):
                self.push[other] -= part
                self.twist[other] -= (x - self.boundary.centre[other, pose]).cross(part)
