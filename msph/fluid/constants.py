"""Constants of a scene that the fluid's kernels read at run time."""

import taichi as ti

from msph.device_table import DeviceTable, f32, i32

vec3, ivec3 = ti.math.vec3, ti.math.ivec3

MEMBERS = {
    "size": vec3,  # of the box [m]
    "walls": vec3,  # coordinates of the far walls, NO_WALL where there is none [m]
    "covered": i32,  # walls behind pistons, which mirror nothing, as bits
    "rim": f32,  # height at which the side walls end, NO_WALL with a lid [m]
    "ceiling": f32,  # height above which water counts as spilt [m]
    "layers": i32,  # number of layers
    "bodies": i32,  # number of bodies
    "leak": f32,  # depth in a body beyond which a particle has leaked [m]
    "finest_spacing": f32,  # [m]
    "rest_density": f32,  # [kg/m^3]
    "restitution": f32,  # ratio of speeds after and before contact with a wall (-)
    "cells": i32,  # of the neighbour grids of all layers
    "entries": i32,  # capacity of the neighbour list
    "mean_neighbours": f32,  # upper bound of the mean at rest, images included
    "cfl": f32,  # largest distance past neighbours per step, in spacings
    "pressure_cfl": f32,  # largest distance at the speed sqrt(p/rho) per step, in spacings
    "release": f32,  # time in which a density excess becomes velocity [s]
    "spray": f32,  # relative density of spray (-)
    "air": f32,  # factor of the air share (-): 0 under surface tension, otherwise 1
    "largest_shift": f32,  # largest position correction in a step, in spacings
    "relaxation": f32,  # of the position correction's Jacobi iteration (-)
    "slip": i32,  # 1: walls do not brake viscous water
    "depth_cell": f32,  # edge of a cell of the depth grid [m]
    "depth_margin": f32,  # of the covering kernel's support [m]
    "depth_dims": ivec3,  # cells of the depth grid along each axis
    "depth_reach": i32,  # largest searched distance to the surface, in cells
    "hysteresis": f32,  # share of a band's limit by which particles must exceed it (-)
    "settle": i32,  # wait after a split or merge, in units of `every` steps
    "opening_count": i32,  # number of inflows and outflows
}
# Members of the table of inflows and outflows; s: coordinate along the flow, 0 at the opening.
MAX_OPENINGS = 16
OPENING = {
    "centre": vec3,  # [m]
    "along": vec3,  # unit vector of the flow
    "across": vec3,  # unit vectors of the cross-section
    "aslant": vec3,
    "width": f32,  # half width, or radius [m]
    "height": f32,  # half height [m]
    "round": i32,  # 1 for a disc
    "wall": i32,  # wall on which the opening lies, as a bit, or 0
    "zone_begin": f32,  # s from which to 0 velocities are prescribed [m]
    "kept_from": f32,  # s from which water beyond the wall is simulated [m]
    "length": f32,  # of this range, or of the range of s from 0 in which water is removed [m]
    "leaves": i32,  # 1 for an outflow
    "slack": f32,  # half a spacing, by which the zone is wider than the opening [m]
    "edge": f32,  # width by which the opening acts wider [m]
    "speed": f32,  # prescribed at the end of the step [m/s]
    "mean_speed": f32,  # mean over the step [m/s]
}


class Constants(DeviceTable):
    """One-row device table of MEMBERS; kernels read `constants.rest_density[None]`. openings: table
    of inflows and outflows."""

    def __init__(self):
        super().__init__((), **MEMBERS)
        self.openings = DeviceTable((MAX_OPENINGS,), **OPENING)
