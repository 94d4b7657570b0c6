"""Tests of the self-test of GPUs: correct kernels pass, and a GPU that fails is not used."""

import pytest
import taichi as ti

from msph import device, self_test
from msph.self_tests import ATOMIC_LOOP, TESTS, Primitives
from tests.arch_kit import require

GPU = "A GPU, driver 1"


@pytest.fixture
def runs(cache, monkeypatch):
    """Returns the list of self-tested architectures; each self-test fails at the test "density"."""
    asked = []
    monkeypatch.setattr(self_test, "gpu_name", lambda arch: GPU)
    monkeypatch.setattr(self_test, "in_own_process", lambda arch: asked.append(arch) or "density")
    return asked


def test_all_self_tests_pass_here():
    assert self_test.first_failure(TESTS) == self_test.PASSED


@pytest.mark.slow
def test_all_self_tests_pass_on_vulkan():
    """Mesa's software driver llvmpipe, which must not be used, fails only the last test."""
    require("vulkan")
    name = self_test.gpu_name("vulkan")
    expected = ATOMIC_LOOP if "llvmpipe" in name else self_test.PASSED
    assert self_test.in_own_process("vulkan") == expected


PRIMITIVES = ("prefix_sum", "atomic_append", "maximum", "serial_counter", "atomic_in_loop")


@pytest.mark.parametrize("name", PRIMITIVES)
def test_wrong_results_fail(name):
    """A test fails if NumPy is given other numbers than the kernels."""
    primitives = Primitives()
    primitives.numbers = primitives.numbers + 1
    assert not getattr(primitives, name)()


def test_the_first_failure_is_named():
    def broken():
        raise RuntimeError("no such value")

    passes = {"one": lambda: True}
    assert self_test.first_failure({**passes, "two": lambda: False}) == "two"
    assert self_test.first_failure({**passes, "three": broken, "two": lambda: False}) == "three"


def test_a_process_that_crashes_fails():
    assert self_test.in_own_process("no such architecture") == self_test.CRASHED


def test_an_outcome_is_stored_for_its_driver(runs, monkeypatch):
    assert self_test.failed_test("vulkan") == self_test.failed_test("vulkan") == "density"
    assert runs == ["vulkan"]
    monkeypatch.setattr(self_test, "gpu_name", lambda arch: "A GPU, driver 2")
    self_test.failed_test("vulkan")
    assert runs == ["vulkan", "vulkan"]


@pytest.mark.parametrize("text", ["{", "[]", '{"self-test": 7}'])
def test_a_damaged_cache_is_ignored(runs, cache, text):
    cache.parent.mkdir()
    cache.write_text(text)
    assert self_test.failed_test("vulkan") == "density"
    assert runs == ["vulkan"]


def test_a_time_limit_is_not_stored(runs, monkeypatch):
    monkeypatch.setattr(self_test, "in_own_process", lambda arch: runs.append(arch) or "time limit")
    for _ in range(2):
        assert self_test.failed_test("vulkan") == self_test.SLOW
    assert len(runs) == 2


@pytest.mark.parametrize("arch, gpu", [("vulkan", "vulkan"), ("auto", "cuda")])
def test_a_gpu_that_fails_is_replaced_by_the_cpu(runs, monkeypatch, capsys, arch, gpu):
    asked = []
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.setattr(device, "_started", None)
    monkeypatch.setattr(device.atexit, "register", lambda function: None)
    monkeypatch.setattr(ti, "init", lambda arch, **options: asked.append(arch))
    device.start(arch, 2)
    assert runs == [gpu] and asked == [[ti.cpu]]
    assert f"{gpu} failed the self-test 'density': running on the CPU" in capsys.readouterr().err


def test_a_machine_without_the_gpu_tests_nothing(runs, monkeypatch):
    """Without a GPU no self-test runs: Taichi itself reports the lack of a GPU or uses the CPU."""
    monkeypatch.setattr(self_test, "gpu_name", lambda arch: None)
    assert self_test.failed_test("cuda") is None
    assert runs == []
