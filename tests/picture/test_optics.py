import numpy as np
import pytest
import taichi as ti

from msph.picture.look import Look
from msph.picture.optics import bend, cosine_beyond, reflectance, refracted, transmittance

vec3 = ti.math.vec3
WATER_INDEX = Look().refractive_index


@ti.kernel
def surface(c: ti.f32, eta: ti.f32) -> ti.math.vec2:
    """Returns the cosine of refraction and the reflectance at the cosine of incidence c."""
    ct = cosine_beyond(c, eta)
    return ti.math.vec2(ct, reflectance(c, ct, eta))


@ti.kernel
def bent(d: vec3, n: vec3, eta: ti.f32) -> vec3:
    c = -d.dot(n)
    return bend(d, n, c, cosine_beyond(c, eta), eta)


@ti.kernel
def left(absorption: vec3, path: ti.f32) -> vec3:
    return transmittance(absorption, path)


def fresnel(angle, n1, n2):
    """Returns the reflectance by the textbook form with angles."""
    beyond = np.arcsin(n1 / n2 * np.sin(angle))
    s = np.sin(angle - beyond) / np.sin(angle + beyond)
    p = np.tan(angle - beyond) / np.tan(angle + beyond)
    return (s**2 + p**2) / 2


def test_water_reflects_two_percent_at_normal_incidence():
    r0 = ((WATER_INDEX - 1) / (WATER_INDEX + 1)) ** 2
    assert surface(1.0, 1 / WATER_INDEX)[1] == pytest.approx(r0, rel=1e-4)
    assert r0 == pytest.approx(0.02, abs=1e-3)


@pytest.mark.parametrize("degrees", [5, 30, 53, 75, 88])
def test_reflectance_follows_the_fresnel_equations(degrees):
    a = np.radians(degrees)
    got = surface(np.cos(a), 1 / WATER_INDEX)[1]
    assert got == pytest.approx(fresnel(a, 1.0, WATER_INDEX), rel=2e-3)


@pytest.mark.parametrize("degrees", [0, 20, 45, 80])
def test_refraction_follows_snells_law(degrees):
    a = np.radians(degrees)
    r = bent(vec3(np.sin(a), -np.cos(a), 0), vec3(0, 1, 0), 1 / WATER_INDEX)
    assert r[0] == pytest.approx(np.sin(a) / WATER_INDEX, abs=1e-5)
    assert np.linalg.norm(r) == pytest.approx(1, abs=1e-5)
    plain = refracted(np.array((np.sin(a), -np.cos(a), 0)), np.array((0, 1.0, 0)), 1 / WATER_INDEX)
    np.testing.assert_allclose(list(r), plain, atol=1e-5)


def test_reflection_is_total_beyond_the_critical_angle():
    critical = np.arcsin(1 / WATER_INDEX)
    assert surface(np.cos(critical + 0.02), WATER_INDEX)[1] == pytest.approx(1, abs=1e-5)
    assert surface(np.cos(critical - 0.02), WATER_INDEX)[1] < 0.6


def test_absorption_follows_the_beer_lambert_law():
    k = np.array((1.7, 0.3, 0.14))
    one, two = (np.array(left(vec3(*k), s)) for s in (0.8, 1.6))
    np.testing.assert_allclose(one, np.exp(-k * 0.8), rtol=1e-4)
    np.testing.assert_allclose(two, one**2, rtol=1e-4)
