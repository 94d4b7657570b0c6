"""What benchmarks compare, at sizes that take seconds."""

from bench.methods import solvers


def test_conjugate_gradients_take_fewer_iterations_than_jacobi() -> None:
    """Twelve sheets, from nothing and from the last step's pressures, at no larger error."""
    rows = solvers(layers=1, sheets=12)
    assert [row["start"] for row in rows] == ["cold", "warm"]
    for row in rows:
        assert int(row["conjugate gradients"].split()[0]) < int(row["Jacobi"].split()[0])
