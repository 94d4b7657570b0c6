"""Arrays that are kept between runs in the user's cache folder."""

import numpy as np
import pytest

from msph import kept_arrays
from msph.kept_arrays import kept
from msph.scene.meshes import MeshError, load_mesh


@pytest.fixture
def folder(cache):
    return cache.parent / "arrays"


def counted():
    """Returns a function that returns two arrays, and the list of its calls."""
    calls = []

    def compute():
        calls.append(1)
        return [np.arange(6.0).reshape(2, 3), np.array(len(calls))]

    return compute, calls


def test_arrays_are_computed_once_for_each_input_and_each_version_of_the_code(folder, monkeypatch):
    compute, calls = counted()
    given = np.array([1.0, 2.0]), "a"
    first = kept(compute, *given)
    again = kept(compute, *given)
    assert len(calls) == 1
    for a, b in zip(first, again, strict=True):
        assert np.array_equal(a, b) and a.dtype == b.dtype
    for other in (
        (np.nextafter(given[0], 2.0), "a"),
        (given[0], "b"),
        (given[0].astype(np.float32), "a"),
        (given[0][:, None], "a"),
    ):
        before = len(calls)
        kept(compute, *other)
        assert len(calls) == before + 1
    monkeypatch.setattr(kept_arrays, "code", lambda: "changed")
    kept(compute, *given)
    assert len(calls) == 6


@pytest.mark.parametrize("damage", ["empty", "text", "flipped", "encrypted"])
def test_damaged_files_are_computed_again(folder, damage):
    compute, calls = counted()
    kept(compute)
    (file,) = folder.iterdir()
    content = file.read_bytes()
    # In the first entry of the directory at the end, bit 0 of the flags at byte 8 marks encryption.
    flags = content.index(b"PK\1\2") + 8
    damaged = {
        "empty": b"",
        "text": b"PK\3\4 not a file",
        "flipped": content[:150] + bytes(255 - b for b in content[150:160]) + content[160:],
        "encrypted": content[:flags] + b"\1" + content[flags + 1 :],
    }
    file.write_bytes(damaged[damage])
    assert np.array_equal(kept(compute)[0], np.arange(6.0).reshape(2, 3)) and len(calls) == 2
    kept(compute)
    assert len(calls) == 2


def test_only_the_newest_files_are_kept_and_a_full_disk_is_no_error(folder, monkeypatch):
    monkeypatch.setattr(kept_arrays, "MOST", 3)
    compute, calls = counted()
    for k in range(6):
        kept(compute, k)
    assert len(list(folder.iterdir())) == 3
    monkeypatch.setattr(kept_arrays.np, "savez", lambda *_: (_ for _ in ()).throw(OSError("full")))
    assert len(kept(compute, "new")) == 2 and len(calls) == 7


def test_a_kept_mesh_follows_its_files(folder, tmp_path):
    corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n"
    faces = "usemtl red\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
    mesh, library = tmp_path / "a.obj", tmp_path / "a.mtl"

    def load():
        load_mesh.cache_clear()
        return load_mesh(str(mesh))

    mesh.write_text(f"mtllib a.mtl\n{corners}{faces}")
    library.write_text("newmtl red\nKd 1 0 0\n")
    assert np.allclose(load()[2], (1.0, 0.0, 0.0)) and np.allclose(load()[2], (1.0, 0.0, 0.0))
    library.write_text("newmtl red\nKd 0 0 1\n")
    assert np.allclose(load()[2], (0.0, 0.0, 1.0))
    library.unlink()
    with pytest.raises(MeshError, match=r"there is no file a\.mtl"):
        load()
    mesh.write_text(corners + faces.removeprefix("usemtl red\n"))
    vertices, triangles, albedos = load()
    assert len(vertices) == 4 and len(triangles) == 4 and albedos is None
    mesh.unlink()
    with pytest.raises(MeshError, match="no such mesh"):
        load()
    load_mesh.cache_clear()
