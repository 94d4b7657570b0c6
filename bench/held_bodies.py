"""Cases of held and moved bodies of bench/bodies.py: pressures, buoyancy, gaps, energy."""

import itertools
import math
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from bench import tanks
from msph.fluid.boundary.rigid_bodies import volume
from msph.fluid.external_forces import ExternalForces
from msph.fluid.simulation import Simulation
from msph.measure.ledger import Ledger
from msph.measure.snapshot import Snapshot

# Simulated time of runs to rest or past a ball [s], and the share of it in which the water settles
# before the measurement.
SECONDS, SETTLING = 2.0, 0.5
# Still water: edge of the square box, depth, finest spacing [m]; number of layers by name.
EDGE, DEPTH, FINE = 0.6, 0.4, 0.025
WATERS = {"uniform": 1, "layered": 3}
# Half width of the pillar, centre and radius of the ball, and radii of further balls [m].
HALF, MIDDLE, RADIUS = 0.075, (0.3, 0.2, 0.3), 0.1
RADII = (0.03, 0.05, 0.075, 0.1, 0.15)
# Gravity [m/s^2] under which a column of water collapses past a ball, and the radii of the balls
# over the spacing (-).
SLANTED, SIZES = (5.0, -6.5, 5.0), (0.2, 0.5, 1.0, 1.5, 2.5, 4.0)
# Bodies next to floor and wall, with gaps in spacings.
GAPS = [
    (kind, gap)
    for kind in ("ball on the floor", "ball at a wall", "box at a wall")
    for gap in ((0.05 if "box" in kind else 0.0), 0.5, 1.0, 2.0)
]
# Balls that move at floor and wall after HELD [s] at rest: speed [m/s], way [m], and time over
# which a force is averaged [s].
SLOW, WAY, HELD, MEAN = 0.05, 0.075, 1.5, 0.25
MOVES = {
    "sinks to the floor": "vertical",
    "rises from the floor": "vertical",
    "passes along the wall": "away from the wall",
}
SPANS = [
    f"{a:g} to {b:g} s" for a, b in itertools.pairwise(np.arange(0.0, WAY / SLOW + MEAN / 2, MEAN))
]
# Name of the vertical force on a body.
WEIGHT = "force over displaced weight"
# No points, (0, 3).
NOWHERE = np.zeros((0, 3))


def still_water(bodies: list[dict[str, Any]], layers: int, seed: int) -> Simulation:
    """Returns a simulation of a tank of still water with bodies."""
    tank = tanks.tank((EDGE, EDGE), DEPTH, FINE, layers, air=0.15, seed=seed, bodies=bodies)
    return tanks.build(tank)


def sphere(n: int) -> np.ndarray:
    """Returns n evenly spread unit vectors, (n, 3), by the golden section."""
    y = 1.0 - 2.0 * (np.arange(n) + 0.5) / n
    turn, ring = np.pi * (3.0 - 5.0**0.5) * np.arange(n), np.sqrt(1.0 - y**2)
    return np.column_stack([ring * np.cos(turn), y, ring * np.sin(turn)])


def settle(sim: Simulation, points: np.ndarray = NOWHERE) -> tuple[np.ndarray, np.ndarray, Ledger]:
    """Runs a simulation; returns the mean pressures [Pa] at points (n, 3) [m] and the mean force
    on the bodies [N] after the water has settled, and the ledger of the whole run."""
    frames, readings = round(SECONDS / tanks.FRAME), []
    settled = round(SETTLING * frames)

    def read() -> None:
        frame = round(sim.time / tanks.FRAME)
        if frame > settled and frame % 6 == 0:
            readings.append(Snapshot.of(sim).pressures(points))

    ledger = tanks.recorded(sim, SECONDS, read=read)
    first, last = ledger.entries[settled], ledger.entries[-1]
    force = (first.body_impulse - last.body_impulse) / (last.time - first.time)
    return np.mean(readings, axis=0), force, ledger


def pillar_points(lo: np.ndarray, hi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Returns points (n, 3) on the four sides of a pillar, below the surface, and their normals."""
    y, across = (a.ravel() for a in np.meshgrid(np.linspace(0.05, 0.3, 6), np.linspace(0, 1, 5)))
    points, normals = [], []
    for axis, other in ((0, 2), (2, 0)):
        for end, sign in ((lo, -1.0), (hi, 1.0)):
            side, normal = np.zeros((y.size, 3)), np.zeros((y.size, 3))
            side[:, axis], normal[:, axis] = end[axis], sign
            side[:, 1], side[:, other] = y, lo[other] + across * (hi - lo)[other]
            points.append(side)
            normals.append(normal)
    return np.concatenate(points), np.concatenate(normals)


def worst_side(ratio: np.ndarray, normals: np.ndarray) -> float:
    """Returns the largest mean error (-) of the sides; points with normals (n, 3) in the same
    direction belong to the same side."""
    axis = np.abs(normals).argmax(axis=1)
    sides = 2 * axis + (np.take_along_axis(normals, axis[:, None], axis=1)[:, 0] > 0.0)
    means = [ratio[sides == side].mean() for side in np.unique(sides)]
    return max(means, key=abs)


def faces(kind: str, water: str, seed: int) -> dict[str, float]:
    """Returns the figures of the pressures on a body in still water."""
    ball, mesh = kind.endswith("ball"), kind.startswith("mesh")
    lo, hi = np.array(MIDDLE) - HALF, np.array(MIDDLE) + HALF
    if ball:
        body: dict[str, Any] = {"centre": MIDDLE, "radius": RADIUS}
        shape = trimesh.creation.icosphere(4, radius=RADIUS).apply_translation(MIDDLE)
        normals = sphere(60)
        points, areas = np.array(MIDDLE) + RADIUS * normals, 4.0 * math.pi * RADIUS**2 / 60
        if mesh:  # its faces lie inside the ball
            points, normals, areas = shape.triangles_center, shape.face_normals, shape.area_faces
    else:
        points, normals = pillar_points(lo, hi)
        lo[1], hi[1] = 0.0, DEPTH + 0.1
        body = {"lo": lo.tolist(), "hi": hi.tolist()}
        # A mesh on the floor should reach into it.
        shape = trimesh.creation.box(bounds=[lo - [0.0, 0.1, 0.0], hi])
    with tempfile.TemporaryDirectory() as folder:
        if mesh:
            body = {"mesh": str(Path(folder) / "body.obj")}
            shape.export(body["mesh"])
        sim = still_water([body], WATERS[water], seed)
    sunk, area = (volume(sim.boundary.bodies[0]), 0.0) if ball else (0.0, 4.0 * HALF**2)
    level = (tanks.water_volume(sim) + sunk) / (EDGE**2 - area)
    found, force, ledger = settle(sim, points)
    ratio = found / (1000.0 * tanks.GRAVITY * (level - points[:, 1])) - 1.0
    row = {
        "pressure, mean": ratio.mean(),
        "worst side, mean": worst_side(ratio, normals),
        "rms": np.sqrt((ratio**2).mean()),
        "worst point": ratio[np.abs(ratio).argmax()],
        "energy rise in 1 s": ledger.energy_rise(),
    }
    if ball:
        integral = -np.sum(found * normals[:, 1] * areas)
        row[WEIGHT] = force[1] / displaced_weight(sim)
        row["pressure integral over force"] = integral / force[1] - 1.0
    return row


def displaced_weight(sim: Simulation) -> float:
    """Returns the weight of the water that the body displaces [N]."""
    return 1000.0 * tanks.GRAVITY * volume(sim.boundary.bodies[0])


def buoyancy(radius: float, seed: int) -> dict[str, float]:
    """Returns the force on a submerged ball of `radius` [m]."""
    sim = still_water([{"centre": MIDDLE, "radius": radius}], 1, seed)
    return {WEIGHT: settle(sim)[1][1] / displaced_weight(sim)}


def at_wall(kind: str, gap: float, seed: int) -> dict[str, float]:
    """Returns the force on a body `gap` spacings from the floor or a wall."""
    near = gap * FINE
    if kind == "box at a wall":
        # A swing with an amplitude of 1e-9 m, since a moving box is not extended into the wall.
        lo, hi = [near, 0.1, 0.2], [near + 0.2, 0.3, 0.4]
        body: dict[str, Any] = {"lo": lo, "hi": hi, "swing": [1e-9, 0, 0]}
    else:
        place = [EDGE / 2, near + RADIUS, EDGE / 2]
        body = {"centre": place if kind == "ball on the floor" else [place[1], 0.2, place[0]]}
        body["radius"] = RADIUS
    sim = still_water([body], 1, seed)
    force = settle(sim)[1] / displaced_weight(sim)
    return {"vertical": force[1], "away from the wall": force[0]}


def moving(kind: str, seed: int) -> dict[str, float]:
    """Returns the force on a ball that moves slowly at the floor or a wall, over its displaced
    weight: means over the SPANS."""
    gap = {"sinks to the floor": WAY, "rises from the floor": 0.0}.get(kind, 0.5 * FINE)
    way = f"{SLOW}*min(max(t - {HELD}, 0), {WAY / SLOW})"
    if "floor" in kind:
        centre = [EDGE / 2, gap + RADIUS, EDGE / 2]
        path, axis = ["0", way if gap == 0.0 else f"-{way}", "0"], 1
    else:
        centre, path, axis = [gap + RADIUS, 0.2, (EDGE - WAY) / 2], ["0", "0", way], 0
    body = {"centre": centre, "radius": RADIUS, "displacement": path}
    sim = still_water([body], 1, seed)
    tanks.run(sim, HELD)
    found = {}
    for name in SPANS:
        begin, impulse = sim.time, float(sim.boundary.impulse[0, axis])
        tanks.run(sim, MEAN)
        force = (float(sim.boundary.impulse[0, axis]) - impulse) / (sim.time - begin)
        found[name] = force / displaced_weight(sim)
    return found


def collapse(ratio: float, seed: int) -> dict[str, float]:
    """Returns the figures of the energy of a column of water that collapses past a ball of
    `ratio` spacings radius."""
    spacing = 0.03
    ball = {"centre": [0.4, 0.1, 0.35], "radius": ratio * spacing}
    water = {"lo": [0, 0, 0], "hi": [0.3, 0.4, EDGE]}
    sim = tanks.build(tanks.scene([EDGE] * 3, spacing, 1, [water], seed=seed, bodies=[ball]))
    slanted = ExternalForces(SLANTED)
    ledger = tanks.recorded(sim, SECONDS, lambda time: slanted, density_every=0.0)
    return {
        "energy rise in 1 s": ledger.energy_rise(),
        "solver residual, 99th percentile": ledger.solver_residual()[1],
        "outside": max(e.outside for e in ledger.entries),
    }
