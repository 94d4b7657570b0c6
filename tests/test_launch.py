"""Kernels that start fast do what Taichi's own do."""

import pytest
import taichi as ti
from taichi.lang.kernel_impl import Kernel

from msph.launch import data_oriented, kernel

SIZE = 8


@data_oriented
class Scaled:
    """Fields whose elements are this object's `factor` times what they are told."""

    def __init__(self, factor: float):
        self.factor = factor
        self.one, self.other = (ti.field(ti.f32, shape=SIZE) for _ in range(2))

    @kernel
    def fill(self, count: ti.i32, target: ti.template(), negative: ti.template(), value: ti.f32):
        for i in range(count):
            target[i] = self.factor * (-value if ti.static(negative) else value)

    @kernel
    def total(self, count: ti.i32) -> ti.f32:
        found = 0.0
        for i in range(count):
            found += self.one[i]
        return found

    @kernel
    def wet(self, level: ti.f32) -> ti.i32:
        found = 0
        for i in range(SIZE):
            found += ti.select(self.one[i] > level, 1, 0)
        return found

    @kernel
    def load(self, values: ti.types.ndarray(dtype=ti.f32, ndim=1)):
        for i in range(SIZE):
            self.one[i] = values[i]


@pytest.fixture(scope="module")
def pair() -> tuple[Scaled, Scaled]:
    return Scaled(2.0), Scaled(3.0)


def test_each_launch_has_its_own_numbers_templates_and_object(pair) -> None:
    two, three = pair
    for value, count in ((1.5, 8), (0.25, 3), (-4.0, 5)):
        for scaled in pair:
            for field, sign in ((scaled.one, 1.0), (scaled.other, -1.0)):
                field.fill(7.0)
                scaled.fill(count, field, sign < 0.0, value)
                expected = [sign * scaled.factor * value] * count + [7.0] * (SIZE - count)
                assert field.to_numpy().tolist() == expected
        assert two.total(count) == 2.0 * value * count
        assert three.total(count) == 3.0 * value * count
        assert three.wet(6.5) == SIZE - count + count * (3.0 * value > 6.5)


def test_arrays_go_through_taichi(pair) -> None:
    values = 0.5 * pair[0].one.to_numpy() + 1.0
    pair[0].load(values)
    assert pair[0].one.to_numpy().tolist() == values.tolist()


def test_later_launches_skip_taichis_python(pair, monkeypatch) -> None:
    one = pair[0]
    first = one.total(SIZE)

    def refuse(*args):
        raise AssertionError("went through Taichi again")

    monkeypatch.setattr(Kernel, "__call__", refuse)
    monkeypatch.setattr(Kernel, "ensure_compiled", refuse)
    assert one.total(SIZE) == first


def test_wrong_arguments_are_refused(pair) -> None:
    pair[0].total(SIZE)
    with pytest.raises(TypeError):
        pair[0].total(2.5)
    for wrong in ((), (SIZE, SIZE)):
        with pytest.raises(ti.TaichiSyntaxError):
            pair[0].total(*wrong)
