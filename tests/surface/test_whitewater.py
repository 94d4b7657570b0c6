"""Tests of whitewater: emission, and the motion of spray, foam and bubbles."""

import numpy as np
import pytest
from surface_kit import FINE, SIZE, packed

from msph.launches import watch_launches
from msph.surface.whitewater import KINETIC, LIFE, MOST, RISE, Whitewater, whitewater_of

GRAVITY = (0.0, -9.81, 0.0)
FAST = 10.0  # at least the speed of the water in these tests [m/s]
LEVEL = 0.2  # water level of the pool [m]


@pytest.fixture
def pool(water):
    water.fill(packed((0, 0, 0), (SIZE[0], LEVEL, SIZE[2]), FINE))
    return water


@pytest.fixture
def whitewater(pool) -> Whitewater:
    found = pool.state.build_once(whitewater_of)
    pool.take()
    pool.state.grid.refresh()
    found.reset()
    return found


def set_velocity(pool, v: np.ndarray) -> None:
    pool.particles.fill(x=pool.particles.numpy("x"), layer=pool.particles.numpy("layer"), v=v)
    pool.grid.build()
    pool.take()


def state(whitewater: Whitewater) -> dict[str, np.ndarray]:
    """Returns the positions, velocities and lifetimes of all living whitewater particles."""
    table = {name: getattr(whitewater.table, name).to_numpy() for name in whitewater.table.fields}
    return {name: values[table["life"] > 0.0] for name, values in table.items()}


def put(whitewater: Whitewater, x: tuple[float, float, float], v=(0.0, 0.0, 0.0)) -> None:
    whitewater.table.fill(x=[x], v=[v], life=[1.0])


def test_nothing_is_launched_before_water_is_fast(pool, whitewater):
    def launches(speed: float) -> list[str]:
        with watch_launches(lambda _, name: found.append(name)):
            found: list[str] = []
            whitewater.advance(0.02, GRAVITY, speed)
        return found

    slow, fast = np.sqrt(2.0 * KINETIC[0]) * np.array([0.99, 1.01])
    assert [launches(v) for v in (0.0, slow, fast, slow)] == [[], [], *[["move", "emit"]] * 2]
    whitewater.reset()
    assert launches(slow) == []


def test_calm_water_and_uniformly_moving_water_emit_nothing(pool, whitewater):
    for speed in (0.0, 3.0):
        set_velocity(pool, np.tile(np.float32([0.0, -speed, 0.0]), (pool.particles.count, 1)))
        for _ in range(5):
            whitewater.advance(0.02, GRAVITY, FAST)
        assert len(state(whitewater)["life"]) == 0


def test_converging_water_emits_up_to_the_limit(pool, whitewater):
    x = pool.particles.numpy("x")
    v = np.zeros_like(x)
    v[:, 0] = np.where(x[:, 0] < 0.5 * SIZE[0], 2.0, -2.0)
    set_velocity(pool, v)
    whitewater.advance(0.02, GRAVITY, FAST)
    found = state(whitewater)["x"]
    assert len(found) > 20
    assert np.abs(found[:, 0] - 0.5 * SIZE[0]).max() < 4 * FINE
    for _ in range(40):
        whitewater.advance(0.02, GRAVITY, FAST)
    assert 100 < len(state(whitewater)["life"]) <= MOST
    assert whitewater.emitted[None] > len(state(whitewater)["life"])


def test_spray_flies_and_bubbles_rise(whitewater):
    put(whitewater, (0.3, 0.45, 0.2), (0.5, 0.0, 0.0))
    for _ in range(10):
        whitewater.advance(0.01, GRAVITY, FAST)
    (x,) = state(whitewater)["x"]
    # By semi-implicit Euler steps, spray falls by g t (t + dt)/2.
    assert x == pytest.approx((0.35, 0.45 - 9.81 * 0.1 * 0.11 / 2, 0.2), abs=1e-4)
    put(whitewater, (0.3, 0.08, 0.2))
    for _ in range(20):
        whitewater.advance(0.01, GRAVITY, FAST)
    (v,) = state(whitewater)["v"]
    assert v == pytest.approx((0.0, RISE, 0.0), abs=0.02)


def test_foam_stays_at_the_surface_and_vanishes(whitewater):
    put(whitewater, (0.3, 0.1, 0.2))
    heights = []
    for _ in range(100):
        whitewater.advance(0.01, GRAVITY, FAST)
        heights.append(state(whitewater)["x"][0, 1])
    assert np.ptp(heights[-20:]) < 0.2 * FINE
    assert heights[-1] == pytest.approx(LEVEL, abs=0.5 * FINE)
    for _ in range(round(LIFE / 0.01)):
        whitewater.advance(0.01, GRAVITY, FAST)
    assert len(state(whitewater)["life"]) == 0


def test_whitewater_stays_within_the_walls(whitewater):
    put(whitewater, (0.3, 0.45, 0.2), (100.0, 100.0, -100.0))
    whitewater.advance(0.1, GRAVITY, FAST)
    (x,) = state(whitewater)["x"]
    assert x == pytest.approx((SIZE[0], SIZE[1], 0.0))
