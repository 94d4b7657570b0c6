"""Tests of checkpoint files: damaged files are refused in one line, and allocate no memory."""

import io
import zipfile

import numpy as np
import pytest

from msph.measure.past import CheckpointError, read_state, time_of


def member(array: np.ndarray, **changes) -> bytes:
    """Returns an array in numpy's format with changes of its header."""
    file = io.BytesIO()
    head = np.lib.format.header_data_from_array_1_0(array) | changes
    np.lib.format.write_array_header_1_0(file, head)
    return file.getvalue() + array.tobytes()


def test_arrays_are_read(tmp_path):
    arrays = {"time": np.float64(0.5), "x": np.zeros((3, 3), np.float32), "about": np.array("a")}
    np.savez_compressed(tmp_path / "a.npz", **arrays)
    found = read_state(tmp_path / "a.npz")
    assert set(found) == set(arrays) and time_of(tmp_path / "a.npz") == 0.5
    assert all(np.array_equal(found[k], v) and found[k].dtype == v.dtype for k, v in arrays.items())


@pytest.mark.parametrize("shape", [(10**18,), (10**7,), (1 << 40, 1 << 40)])
def test_a_header_that_claims_more_than_the_file_holds_is_refused(tmp_path, shape):
    """Regression: arrays of the size in the header were allocated."""
    with zipfile.ZipFile(tmp_path / "a.npz", "w") as archive:
        archive.writestr("time.npy", member(np.zeros(3), shape=shape))
    with pytest.raises(ValueError, match=r"time.npy: has no \("):
        read_state(tmp_path / "a.npz")


def test_an_empty_file_is_refused(tmp_path):
    """Regression: it was reported as an interrupt."""
    (tmp_path / "a.npz").touch()
    with pytest.raises(CheckpointError, match=r"a\.npz: is not a checkpoint"):
        time_of(tmp_path / "a.npz")


@pytest.mark.parametrize("time", [np.inf, np.nan, -1.0, 1e300, 1j, [0.0, 1.0], "soon"])
def test_impossible_times_are_refused(tmp_path, time):
    np.savez(tmp_path / "a.npz", time=np.array(time), x=np.zeros((2, 3)))
    with pytest.raises(CheckpointError, match=r"a\.npz: is not a checkpoint"):
        time_of(tmp_path / "a.npz")


@pytest.mark.parametrize(("place", "value"), [(6, 1), (8, 97)])
def test_encrypted_and_unknown_members_are_refused(tmp_path, place, value):
    """Regression: a flag of encryption and an unknown compression gave unexpected errors."""
    path = tmp_path / "a.npz"
    np.savez(path, time=np.float64(0.0))
    content = bytearray(path.read_bytes())
    for signature, shift in ((b"PK\x03\x04", 0), (b"PK\x01\x02", 2)):
        content[content.index(signature) + place + shift] = value
    path.write_bytes(content)
    with pytest.raises(ValueError, match=r"encrypted|compression"):
        read_state(path)
