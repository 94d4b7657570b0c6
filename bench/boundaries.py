"""Inflows and outflows against theory."""

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from scipy.optimize import brentq

from bench import tanks
from bench.tables import Bench, Case, Table
from msph.fluid.external_forces import ExternalForces
from msph.fluid.simulation import Simulation
from msph.scene.schema import Scene

# Contraction of a plane jet from a sharp-edged slit (Kirchhoff 1869).
CONTRACTION = math.pi / (math.pi + 2.0)
# Emptied tank: length, depth, spacing and width of the slit in the floor [m]; shares of the depth
# between which draining is timed, and share of the width below the floor beyond which the jet's
# speed is measured.
LENGTH, DEEP, FINE, SLIT = 0.5, 0.3, 0.0125, 0.075
LEVELS, BELOW = (0.93, 0.4), 0.9
# Distances below the floor, over the width of the slit, at which the shape of its jet is compared.
ALONG_JET = (0.25, 0.5)
# Tank with a hole: edge and depth, and half width of the hole [m].
VESSEL, HOLE = 0.24, 0.04
# Discharge of square holes over that of round ones (-): 0.627/0.620, measured by Bovey
# (Encyclopaedia Britannica 1911, "Hydraulics").
SQUARE = 1.011
# Basin: edge, depth and spacing [m]; radius [m] and speed [m/s] of the spring.
EDGE, DEPTH, SPACING, RADIUS, SPEED = 0.3, 0.15, 0.025, 0.05, 0.3
# Time [s] between two sheets of particles of the spring, over which masses and levels are averaged.
SHEETS = 13 * SPACING**3 / (math.pi * RADIUS**2 * SPEED)
# Vertical jet: radius [m], speed [m/s], time [s] in which the followed particles enter; heights [m]
# and times [s] between which the head is measured, before water falls back; time [s] at which the
# front has fallen back.
JET_RADIUS, JET_SPEED, FOLLOWED = 0.05, 3.0, 0.05
ALONG, STEADY, FALLEN = (0.1, 0.25), (0.2, 0.35), 0.45
# Jet on a plate in weightlessness, in radii of the jet: spacing, edge of the box, half edge of the
# plate and its distance from the wall; and times between which forces are measured, over that of
# this way.
PLATE_SPACING, BOX, PLATE, WAY, HITTING = 1.0 / 6.0, 16.0, 4.5, 7.0, (2.5, 4.5)
# Sum of 4/z^3 over the zeros z of the Bessel function J0: end correction of a jet over its radius.
END = 0.3223


def inside(sim: Simulation) -> np.ndarray:
    """Returns the heights [m] of the particles in the box."""
    y = sim.particles.numpy("x")[:, 1].astype(float)
    return y[y > 0.0]


def round_discharge(head: float, diameter: float) -> float:
    """Returns the coefficient of discharge (-) of a sharp-edged round hole: Unwin's fit to the
    measurements of Mair (Encyclopaedia Britannica 1911, "Hydraulics"); head, diameter [m]."""
    return 0.6075 + 0.0098 / math.sqrt(head / 0.3048) - 0.0037 * diameter / 0.0254


def plane_contraction(distance: float) -> float:
    """Returns the width of a plane jet over that of its slit (-), at a distance behind the slit
    over its width: Kirchhoff's free streamline, whose direction turns by an angle b from the wall
    to the axis: width 1 - 2 A (1 - cos b) at the distance A (ln(sec b + tan b) - sin b)."""
    a = 1.0 / (math.pi + 2.0)
    last = 0.5 * math.pi - 1e-9
    b = brentq(lambda b: a * (math.asinh(math.tan(b)) - math.sin(b)) - distance, 0.0, last)
    return 1.0 - 2.0 * a * (1.0 - math.cos(b))


def through_slit(seed: int) -> dict[str, float]:
    """Returns the errors of a tank that empties through a slit in its floor."""
    middle = 0.5 * LENGTH
    hole = {"lo": [middle - SLIT / 2, 0, 0], "hi": [middle + SLIT / 2, 0, SLIT]}
    tank = partial(tanks.tank, (LENGTH, SLIT), DEEP, FINE, 1, seed=seed)
    return drained(tank, hole, SLIT, CONTRACTION * SLIT**2, ALONG_JET)


def through_hole(spacing: float, square: bool, seed: int) -> dict[str, float]:
    """Returns the errors of a tank that empties through a round or square hole in its floor."""
    middle, discharge = 0.5 * VESSEL, round_discharge(0.65 * VESSEL, 2.0 * HOLE)
    hole: dict[str, Any] = {"centre": [middle, 0, middle], "radius": HOLE}
    area = discharge * math.pi * HOLE**2
    if square:
        lo, hi = middle - HOLE, middle + HOLE
        hole, area = {"lo": [lo, 0, lo], "hi": [hi, 0, hi]}, SQUARE * discharge * 4.0 * HOLE**2
    tank = partial(tanks.tank, (VESSEL, VESSEL), VESSEL, spacing, 1, seed=seed)
    return drained(tank, hole, 2.0 * HOLE, area)


def drained(
    tank: Callable[..., Scene],
    hole: dict[str, Any],
    width: float,
    area: float,
    along: tuple[float, ...] = (),
) -> dict[str, float]:
    """Returns the errors of a tank that empties through a hole of this width [m], whose contracted
    jet has this area [m^2] by theory: mean speed of the jet over sqrt(2 g h), h the height of the
    level above the particles; its area and the draining time over theory (-). Distances `along` the
    jet of a slit over its width: area there over plane_contraction()."""
    sim = tanks.build(tank(outflows=[hole], duration=30.0))
    spec, surface = sim.layers.specs[0], sim.size[0] * sim.size[2]
    levels, times, ratios, areas = [], [], [], []
    shape: dict[float, list[float]] = {share: [] for share in along}
    full = len(inside(sim)) * spec.volume / surface
    begin, below, deep = LEVELS[0] * full, BELOW * width, 2.0 * spec.spacing
    while not levels or levels[-1] > LEVELS[1] * full:
        sim.advance(tanks.FRAME, tanks.STILL)
        x, v = sim.particles.numpy("x"), sim.particles.numpy("v")
        level = len(inside(sim)) * spec.volume / surface
        levels.append(level)
        times.append(sim.time)
        jet = (x[:, 1] < -below) & (x[:, 1] > -below - deep)
        if level < begin and jet.any():
            fall = np.sqrt(2.0 * tanks.GRAVITY * (level - x[jet, 1]))
            ratios.append(float((np.linalg.norm(v[jet], axis=1) / fall).mean()))
            contracted = area * math.sqrt(level / (level + below + 0.5 * deep))
            areas.append(jet.sum() * spec.volume / deep / contracted)
            for share, found in shape.items():
                depth = share * width
                near = np.abs(x[:, 1] + depth) < spec.spacing
                slower = math.sqrt(level / (level + depth))
                wide = near.sum() * spec.volume / (2.0 * spec.spacing)
                found.append(wide / (plane_contraction(share) * area / CONTRACTION * slower))
    ends = [begin, LEVELS[1] * full]
    taken = np.interp([-h for h in ends], [-h for h in levels], times)
    fall = math.sqrt(ends[0]) - math.sqrt(ends[1])
    theory = surface / area * math.sqrt(2.0 / tanks.GRAVITY) * fall
    sim.close()
    return {
        "speed / sqrt(2 g h) - 1": float(np.mean(ratios)) - 1.0,
        "area of the jet / theory - 1": float(np.mean(areas)) - 1.0,
        "draining time / theory - 1": float(taken[1] - taken[0]) / theory - 1.0,
        **{
            f"{along_jet(share)} - 1": float(np.mean(found)) - 1.0 for share, found in shape.items()
        },
    }


def along_jet(share: float) -> str:
    """Returns the name of the area of a jet at a distance over the width of the hole."""
    return f"area of the jet {share:g} widths below / theory"


def through_flow(seed: int) -> dict[str, float]:
    """Returns the largest changes of mass and level in 30 s, with a spring and a pump of the same
    rate, against the mean from 2 to 4 s. The level is twice the mean height. Values are means over
    the time between two sheets of the spring, each of which is 1.5 % of the mass."""
    flow = {"radius": RADIUS, "speed": SPEED}
    corners = ([0.08, 0, 0.08], [0.22, 0, 0.22])
    spring, pump = ({"centre": corner, **flow} for corner in corners)
    more = {"inflows": [spring], "outflows": [pump], "seed": seed, "duration": 30.0}
    sim = tanks.build(tanks.tank((EDGE, EDGE), DEPTH, SPACING, 1, **more))
    masses, levels = [], []
    for _ in range(round(30.0 / tanks.FRAME)):
        sim.advance(tanks.FRAME, tanks.STILL)
        heights = inside(sim)
        masses.append(float(len(heights)))
        levels.append(2.0 * float(heights.mean()))
    sim.close()
    frames = round(SHEETS / tanks.FRAME)
    first = slice(round(2.0 / tanks.FRAME), round(4.0 / tanks.FRAME))
    after = slice(round(4.0 / tanks.FRAME), None)
    found = {}
    for name, values in (("mass", masses), ("level", levels)):
        smooth = np.convolve(values, np.full(frames, 1.0 / frames), "valid")
        change = np.abs(smooth[after] / smooth[first].mean() - 1.0).max()
        found[f"largest change of the {name} in 30 s"] = float(change)
    return found


def jet(seed: int) -> dict[str, float]:
    """Returns the errors of a jet from a dry floor: height of the front over v^2/(2 g); and
    mean head y + v^2/(2 g), where the jet is steady, over v^2/(2 g) and over theory. The height of
    the front is the mean of the highest points of the particles of the first FOLLOWED seconds.

    An inflow keeps its speed up to the cross-section and gravity slows the water above, so the
    pressure p there does not vanish. By linear theory p is harmonic, 0 at the surface of the jet,
    and dp/dy = -rho g at the cross-section; its mean there, which adds to the head, is
    rho g R sum 4/z^3."""
    corner = {"lo": [0, 0, 0], "hi": [0.1, 0.025, 0.6]}
    spring = {"centre": [0.35, 0, 0.3], "radius": JET_RADIUS, "speed": JET_SPEED}
    more = {"inflows": [spring], "seed": seed, "duration": 0.6}
    sim = tanks.build(tanks.scene((0.6, 0.925, 0.6), FINE, 1, [corner], **more))
    highest: dict[int, float] = {}
    heads = []
    started = set(sim.particles.numpy("id")[sim.particles.numpy("x")[:, 1] > 0.0].tolist())
    while sim.time < FALLEN:
        sim.advance(tanks.FRAME, tanks.STILL)
        y, v = sim.particles.numpy("x")[:, 1].astype(float), sim.particles.numpy("v").astype(float)
        if STEADY[0] < sim.time < STEADY[1]:
            rising = (y > ALONG[0]) & (y < ALONG[1]) & (v[:, 1] > 0.0)
            heads.append((y + (v**2).sum(axis=1) / (2.0 * tanks.GRAVITY))[rising].mean())
        seen = zip(sim.particles.numpy("id").tolist(), y, strict=True)
        for number, height in seen:
            known = number in highest or (sim.time < FOLLOWED and number not in started)
            if known:
                highest[number] = max(highest.get(number, 0.0), float(height))
    sim.close()
    plain = JET_SPEED**2 / (2.0 * tanks.GRAVITY)
    theory, front = plain + END * JET_RADIUS, float(np.mean(list(highest.values())))
    return {
        "height of its front / (v^2/(2 g)) - 1": front / plain - 1.0,
        "steady head / (v^2/(2 g)) - 1": float(np.mean(heads)) / plain - 1.0,
        "steady head / theory - 1": float(np.mean(heads)) / theory - 1.0,
    }


def on_plate(angle: float, seed: int) -> dict[str, float]:
    """Returns the error of the force of a jet on a plate whose normal is turned by `angle` [deg]
    from the jet, over rho A v^2 cos(angle): all water leaves along the plate. The momentum of the
    jet is exact, as its rate and speed are prescribed."""
    edge, spacing, begin = BOX * JET_RADIUS, PLATE_SPACING * JET_RADIUS, WAY * JET_RADIUS
    lo, hi = edge / 2 - PLATE * JET_RADIUS, edge / 2 + PLATE * JET_RADIUS
    plate = {"lo": [begin, lo, lo], "hi": [begin + 2.5 * JET_RADIUS, hi, hi]}
    jet = {"centre": [0, edge / 2, edge / 2], "radius": JET_RADIUS, "speed": JET_SPEED}
    more = {
        "gravity": [0, 0, 0],
        "seed": seed,
        "box": {"size": [edge] * 3, "open": True},
        "inflows": [jet],
        "bodies": [plate | {"angle": str(angle), "axis": [0, 0, 1]}],
    }
    least = {"lo": [0, 0, 0], "hi": [spacing] * 3}  # a scene must have water
    sim, way = tanks.build(tanks.scene([edge] * 3, spacing, 1, [least], **more)), begin / JET_SPEED
    impulses = []
    for until in HITTING:
        while sim.time < until * way:
            sim.advance(0.1 * way, ExternalForces((0.0, 0.0, 0.0)))
        sim.contact.push_bodies()
        impulses.append((sim.time, sim.boundary.impulse[0].copy()))
    (start, first), (end, last) = impulses
    turn = math.radians(angle)
    force = (last - first) @ np.array([math.cos(turn), math.sin(turn), 0.0]) / (end - start)
    sim.close()
    momentum = 1000.0 * math.pi * (JET_RADIUS * JET_SPEED) ** 2
    return {"force / theory - 1": float(force) / (momentum * math.cos(turn)) - 1.0}


def filling(seed: int) -> dict[str, float]:
    """Returns the error of the level in a basin that a spring fills from 0.1 to 0.2 m: twice the
    mean height over the level by rate and time, mean of the last 0.5 s."""
    spring = {"centre": [0.15, 0, 0.15], "radius": RADIUS, "speed": SPEED}
    more = {"inflows": [spring], "seed": seed, "duration": 5.0}
    sim = tanks.build(tanks.tank((EDGE, EDGE), 0.1, SPACING, 1, **more))
    begin = 2.0 * float(inside(sim).mean())
    errors, rate = [], math.pi * RADIUS**2 * SPEED / EDGE**2
    while sim.time < 0.1 / rate:
        sim.advance(tanks.FRAME, tanks.STILL)
        level = begin + rate * sim.time
        errors.append(2.0 * float(inside(sim).mean()) / level - 1.0)
    sim.close()
    last = errors[-round(0.5 / tanks.FRAME) :]
    return {"level / theory - 1": float(np.mean(last))}


def against(title: str, case: Case, targets: dict[str, str]) -> Table:
    """Returns the table of one case, with the targets of its figures."""
    forms = dict.fromkeys(targets, "+.2%")
    return Table(title, (), {("found",): case}, forms, targets, across=True)


def emptied(title: str, case: Case, target: str, along: tuple[float, ...] = ()) -> Table:
    """Returns the table of a tank that empties; target: of the draining time; along: distances at
    which the shape of the jet is compared, over its width."""
    targets = {
        **{f"{along_jet(share)} - 1": "none" for share in along},
        "speed / sqrt(2 g h) - 1": "within 3 %",
        "area of the jet / theory - 1": "none",
        "draining time / theory - 1": target,
    }
    return against(f"Tank {title}", case, targets)


def hole(spacings: int, square: bool, target: str) -> Table:
    """Returns the table of a hole of this number of spacings half width."""
    title = f"{VESSEL} m deep, {'square' if square else 'round'} hole of {spacings} spacings half "
    return emptied(f"{title}width", partial(through_hole, HOLE / spacings, square), target)


BENCHES = {
    "boundaries": Bench(
        "Inflows and outflows",
        "Computed from positions and velocities. The theory of the draining time has the "
        "contraction pi/(pi + 2) = 0.611 of the plane jet for the slit,\nand measured coefficients "
        f"of discharge for holes ({round_discharge(0.65 * VESSEL, 2.0 * HOLE):.3f}, square "
        f"{SQUARE} times as much); the theory of the vertical jet\nhas the head "
        f"v^2/(2 g) + {END} R: "
        'docs/method.md, "Openings".\n',
        {
            "slit": emptied(
                f"{DEEP} m deep, slit {SLIT / FINE:.0f} spacings wide",
                through_slit,
                "within 5 %",
                ALONG_JET,
            ),
            "round": hole(4, False, "within 4 %"),
            "square": hole(4, True, "within 4 %"),
            "fine round": hole(8, False, "within 2 %"),
            "through": against(
                "Spring and pump of the same rate",
                through_flow,
                {
                    f"largest change of the {name} in 30 s": "within 1 %"
                    for name in ("mass", "level")
                },
            ),
            "jet": against(
                f"Vertical jet, {2 * JET_RADIUS / FINE:.0f} spacings in diameter",
                jet,
                {
                    "height of its front / (v^2/(2 g)) - 1": "within 3 %",
                    "steady head / (v^2/(2 g)) - 1": "within 3 %",
                    "steady head / theory - 1": "none",
                },
            ),
            **{
                f"plate {angle}": against(
                    f"Jet of {2 / PLATE_SPACING:.0f} spacings on a plate inclined by {angle} "
                    "degrees",
                    partial(on_plate, angle),
                    {"force / theory - 1": "within 2 %"},
                )
                for angle in (0, 30)
            },
            "filling": against(
                "Basin that a spring fills", filling, {"level / theory - 1": "within 1 %"}
            ),
        },
    )
}
