"""Probes on faces: flux through a rectangle, force and torque on a body."""

from dataclasses import dataclass

import numpy as np

from msph.fluid.boundary.body_faces import samples
from msph.fluid.boundary.rigid_bodies import centre
from msph.measure.probe import Probe, lattice
from msph.measure.snapshot import Snapshot
from msph.scene.bodies import bodies
from msph.scene.schema import Scene
from msph.scene.water import layer_specs

# Largest edge of a body's faces, in finest spacings, and largest number of faces, each read alone.
MAX_EDGE, MAX_FACES = 0.75, 8000


@dataclass
class FluxProbe(Probe):
    """Volume flux [m^3/s] along an axis through a rectangle from lo to hi [m] normal to it."""

    name: str
    lo: tuple[float, float, float]
    hi: tuple[float, float, float]

    @property
    def heads(self) -> list[str]:
        return [f"{self.name} [m^3/s]"]

    def read(self, water: Snapshot) -> list[float]:
        lo, hi = np.array(self.lo), np.array(self.hi)
        axis = int(np.argmin(hi - lo))
        points, area = lattice(lo, hi, water.spacing.min())
        wet, velocity = water.wetted(points, "v")
        return [float(area * (wet * velocity[:, axis]).sum()) if wet.any() else np.nan]


@dataclass
class ForceProbe(Probe):
    """Force [N] of the water on body number `body`, the integral of the pressure over its wet
    faces, and torque [N m] about its centre, in the box's frame.

    At time zero: centre (3,) [m] of the body, centres (f, 3) [m] of its faces relative to it, and
    area vectors (f, 3) [m^2] of the faces, towards the water.
    """

    name: str
    body: int
    centre: np.ndarray
    middles: np.ndarray
    areas: np.ndarray

    @classmethod
    def of(cls, name: str, scene: Scene, body: str) -> "ForceProbe":
        """Returns the probe of a body by its key in the scene: container, bodies.0, ..."""
        known = bodies(scene)
        outer = int(scene.container is not None)
        number = 0 if body == "container" else outer + int(body.rpartition(".")[2])
        edge = MAX_EDGE * min(s.spacing for s in layer_specs(scene))
        points, areas, _ = samples(known[number], edge, MAX_FACES)
        return cls(name, number, centre(known[number]), points, areas)

    @property
    def heads(self) -> list[str]:
        force = [f"{self.name}_force_{k} [N]" for k in "xyz"]
        return force + [f"{self.name}_torque_{k} [N m]" for k in "xyz"]

    def read(self, water: Snapshot) -> list[float]:
        if water.pressure is None:
            return [np.nan] * 6
        offset, turn = water.poses[self.body]
        arms = self.middles @ turn.T
        points = self.centre + offset + arms
        inside = np.all((points >= 0.0) & (points <= np.array(water.size)), axis=1)
        pressures = np.zeros(len(points))
        wet, found = water.wetted(points[inside], "pressure")
        pressures[inside] = wet * found
        forces = -pressures[:, None] * (self.areas @ turn.T)
        return [*forces.sum(axis=0).tolist(), *np.cross(arms, forces).sum(axis=0).tolist()]
