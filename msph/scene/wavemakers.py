"""Wave makers of a scene: bodies in prescribed motion at an end of the box, and beaches."""

import math
from dataclasses import replace

import numpy as np

from msph.fluid.boundary.beach import Beach
from msph.fluid.boundary.rigid_bodies import Block, Scripted, end_block
from msph.fluid.methods import METHODS, methods_with
from msph.parameter import MAX_SPEED
from msph.scene.errors import require
from msph.scene.motion import TOO_FAST, ramp
from msph.scene.schema import Scene, WaveMaker
from msph.scene.water import layer_specs, shape_of

# Exponent of the decay of an amplitude on both ways through a beach: 2 % of a wave return.
DECAY = 4.0
# Largest slope of a flap (-).
STEEPEST = 1.0


def wave_makers(scene: Scene) -> list[Block]:
    """Returns the bodies of the wave makers: blocks that fill the cross-section of the box."""
    return [_body(scene, maker, f"wavemakers.{k}") for k, maker in enumerate(scene.wavemakers)]


def _body(scene: Scene, maker: WaveMaker, name: str) -> Block:
    axis, far_end = _end(maker)
    sign = -1.0 if far_end else 1.0
    along, still = np.eye(3)[axis], np.zeros(3)
    rate, depth = 2.0 * math.pi / maker.period, water_depth(scene)

    def swing(time: float) -> float:
        part = ramp(time / maker.ramp) if maker.ramp else 1.0
        return 0.5 * sign * maker.stroke * part * math.sin(rate * time)

    # The slope of the ramp is at most 15/8 over its duration.
    top = 0.5 * maker.stroke * (rate + (1.875 / maker.ramp if maker.ramp else 0.0))
    face = _face(scene, maker)
    motion = Scripted(lambda time: (swing(time) * along, 0.0), (0, 1, 0), still, top)
    block = end_block(scene.box.size, _reach(scene), sign * along, face, motion, name)
    if maker.kind == "piston":
        return block
    hinge = np.zeros(3)
    hinge[axis] = (block.lo if far_end else block.hi)[axis]
    # A positive angle about z turns y to -x, about x to +z.
    turn = (0.0, 0.0, -1.0) if axis == 0 else (1.0, 0.0, 0.0)
    swinging = Scripted(
        lambda time: (still, math.atan(swing(time) / depth)),
        turn,
        hinge - 0.5 * (block.lo + block.hi),
        top * scene.box.size[1] / depth,
    )
    return replace(block, motion=swinging)


def beaches(scene: Scene) -> list[Beach]:
    """Returns the beaches opposite to the wave makers."""
    found = []
    for maker in scene.wavemakers:
        if maker.beach:
            axis, far_end = _end(maker)
            wall = axis if far_end else 3 + axis
            speed = group_speed(scene, maker)
            # The mean damping rate is a third of the largest; amplitudes decay at half the rate,
            # for the time 2 length/speed.
            found.append(Beach(wall, maker.beach, 3.0 * DECAY * speed / maker.beach))
    return found


def group_speed(scene: Scene, maker: WaveMaker) -> float:
    """Returns the speed [m/s] of the energy of a maker's waves by linear theory."""
    depth, gravity = water_depth(scene), math.hypot(*scene.gravity)
    k = wave_number(maker.period, depth, gravity)
    share = 0.5 + k * depth / math.sinh(2.0 * k * depth) if k * depth < 50.0 else 0.5
    return share * 2.0 * math.pi / maker.period / k


def wave_number(period: float, depth: float, gravity: float) -> float:
    """Returns k [1/m] of waves of a period [s]: omega^2 = g k tanh(k depth)."""
    from scipy.optimize import brentq  # 0.2 s to import, and only wave makers need it

    deep = (2.0 * math.pi / period) ** 2 / gravity
    shallow = math.sqrt(deep / depth)
    most = 1.001 * (deep + shallow)
    return float(brentq(lambda k: k * math.tanh(k * depth) - deep, 0.0, most))


def water_depth(scene: Scene) -> float:
    """Returns the height [m] of the highest volume of water at the start."""
    return max(float(shape_of(water).bounds[1][1]) for water in scene.water)


def _end(maker: WaveMaker) -> tuple[int, bool]:
    """Returns the axis of a maker, and True if it is at its far end."""
    return "xyz".index(maker.end[1]), maker.end[0] == "+"


def _reach(scene: Scene) -> float:
    """Returns the largest reach [m] of a kernel."""
    return max(spec.support for spec in layer_specs(scene))


def _nearest(scene: Scene, maker: WaveMaker) -> float:
    """Returns the least mean distance [m] of the face from the wall; if the face were nearer, the
    wall would mirror the water in front of it."""
    return 0.5 * (maker.stroke + _reach(scene))


def _face(scene: Scene, maker: WaveMaker) -> float:
    """Returns the mean distance [m] of the face from the wall behind it."""
    return _nearest(scene, maker) if maker.position is None else maker.position


def check_wave_makers(scene: Scene) -> None:
    """Raises SceneError for a wave maker that cannot be built."""
    if not scene.wavemakers:
        return
    able, (x, y, z) = methods_with("HAS_BODIES"), scene.gravity
    problem = f"the method {scene.method} has none; {able} has"
    require(METHODS[scene.method].HAS_BODIES, "wavemakers", problem)
    require(scene.container is None, "wavemakers", "need the walls of a box, not a container")
    require(y < 0.0 and x == z == 0.0, "wavemakers", "need gravity along -y")
    ends = [maker.end for maker in scene.wavemakers]
    for k, maker in enumerate(scene.wavemakers):
        key, axis, first = f"wavemakers.{k}", _end(maker)[0], ends.index(maker.end)
        require(first == k, f"{key}.end", f"wavemakers.{first} is at this end")
        free = not maker.beach or "+-"[maker.end[0] == "+"] + maker.end[1] not in ends
        require(free, f"{key}.beach", "there is a wave maker at the other end")
        least, face, room = _nearest(scene, maker), _face(scene, maker), scene.box.size[axis]
        require(
            face >= least,
            f"{key}.position",
            f"must be at least {least:.3g} m, half the stroke and half the reach of a particle "
            f"(got {face:g})",
        )
        fits = face + 0.5 * maker.stroke + maker.beach < room
        require(fits, key, f"with its stroke and beach it does not fit in {room:g} m")
        speed = wave_makers(scene)[k].motion.top_speed(0.0)
        require(speed <= MAX_SPEED, key, f"moves at {speed:.3g} m/s; {TOO_FAST}")
        gentle = maker.kind != "flap" or 0.5 * maker.stroke <= STEEPEST * water_depth(scene)
        problem = f"would tilt the flap by more than 45 degrees (got {maker.stroke:g})"
        require(gentle, f"{key}.stroke", problem)
