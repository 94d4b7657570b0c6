"""Tests of sums and products of small matrices in kernels, against NumPy."""

import numpy as np
import pytest
import taichi as ti

RNG = np.random.default_rng(4)
A, B, X, Y = (RNG.normal(size=size).astype(np.float32) for size in ((3, 3), (3, 3), 3, 3))
CASES = {
    "matrix_vector": lambda a, b, x, y: a @ x,
    "vector_matrix": lambda a, b, x, y: x @ a,
    "matrix_matrix": lambda a, b, x, y: (a @ b)[:, 1],
    "sums": lambda a, b, x, y: np.array([x.sum(), x @ y, a.sum()]),
    "extremes": lambda a, b, x, y: np.array([x.max(), a.min(), np.linalg.norm(y)]),
    "cross_products": lambda a, b, x, y: np.cross(x, y),
    "transposes": lambda a, b, x, y: a.T @ y,
    "limits": lambda a, b, x, y: np.clip(y, x, 0.5),
    "logic": lambda a, b, x, y: np.array([(x > 9).any(), (x > -9).all(), (x > 9).all()]),
}


@pytest.fixture(scope="module")
def results() -> dict[str, np.ndarray]:
    """Returns the results of a kernel by case."""
    out, calls = ti.Vector.field(3, ti.f32, len(CASES)), ti.field(ti.i32, ())

    @ti.func
    def once(x):
        calls[None] += 1
        return x

    @ti.kernel
    def run(a: ti.math.mat3, b: ti.math.mat3, x: ti.math.vec3, y: ti.math.vec3):
        product = a @ b
        out[0] = a @ once(x)
        out[1] = x @ a
        out[2] = ti.Vector([product[0, 1], product[1, 1], product[2, 1]])
        out[3] = ti.Vector([once(x).sum(), x.dot(y), a.sum()])
        out[4] = ti.Vector([x.max(), a.min(), y.norm()])
        out[5] = x.cross(once(y))
        out[6] = a.transpose() @ y
        out[7] = ti.math.clamp(once(y), x, 0.5)
        out[8] = ti.cast(ti.Vector([(x > 9).any(), (x > -9).all(), (x > 9).all()]), ti.f32)

    run(*(ti.Matrix(m) for m in (A, B)), *(ti.Vector(v) for v in (X, Y)))
    # Each argument is evaluated once.
    assert calls[None] == 4
    return dict(zip(CASES, out.to_numpy(), strict=True))


@pytest.mark.parametrize("case", CASES)
def test_results_are_those_of_numpy(results, case) -> None:
    function = CASES[case]
    np.testing.assert_allclose(results[case], function(A, B, X, Y), rtol=1e-5, atol=1e-6)


def test_python_scope_is_unchanged() -> None:
    assert ti.Vector([3.0, 4.0]).norm() == 5.0
    assert ti.math.clamp(2.0, 0.0, 1.0) == 1.0
    assert ti.Vector([1.0, 0.0, 0.0]).cross(ti.Vector([0.0, 1.0, 0.0])).to_list() == [0.0, 0.0, 1.0]
    assert (ti.Matrix([[1.0, 2.0], [3.0, 4.0]]) @ ti.Vector([1.0, 1.0])).to_list() == [3.0, 7.0]


def test_wrong_shapes_are_refused() -> None:
    @ti.kernel
    def wrong():
        print(ti.Matrix([[1.0, 2.0], [3.0, 4.0]]) @ ti.Vector([1.0, 1.0, 1.0]))

    with pytest.raises(ti.TaichiCompilationError):
        wrong()
