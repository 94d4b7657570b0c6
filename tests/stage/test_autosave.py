"""Tests of autosave: sessions are saved, removed at a normal end, and offered after a crash."""

import os
import threading

import numpy as np
import psutil
import pytest

from msph.errors import BlowUpError
from msph.measure.timings import Timings
from msph.stage import autosave
from msph.stage.autosave import Autosaver, forget, lost_session, offer, session_file
from msph.stage.choice import Choice, SceneArguments
from msph.stage.loop import run
from msph.stage.recorded_input import Header
from msph.stage.row import Row
from msph.stage.show import INTERACTIVE, Show
from msph.stage.window import ClosedError
from tests.scenes_kit import load
from tests.stage.player_kit import FRAME
from tests.stage.test_recording import Count


@pytest.fixture(autouse=True)
def folder(cache, monkeypatch):
    """Returns the folder of the files, which are due in every frame."""
    monkeypatch.setattr(autosave, "INTERVAL", 0.0)
    return cache.parent


@pytest.fixture
def others(monkeypatch):
    """Makes the processes that wrote saved files appear to have ended."""
    monkeypatch.setattr(psutil, "Process", lambda number: (_ for _ in ()).throw(ValueError))


@pytest.fixture
def row(tmp_path):
    show = Show(load(tmp_path), FRAME, timings=Timings(keep=1), **INTERACTIVE)
    row = Row([show])
    yield row
    row.close()


def session(row, scene, *frames, end=None):
    """Runs a session of the given numbers of frames in turn, and raises `end`, if given."""
    with session_file() as path:
        saver = Autosaver(path, Header.of(scene, "large"))
        for number in frames:
            run(row, Count(), number, [saver])
            if saver.writer:
                saver.writer.join()
        if end:
            raise end


def test_a_session_continues_where_it_was_saved(row, tmp_path, folder, others):
    scene = str(tmp_path / "small.toml")
    row.set("gravity", 5.0)
    with pytest.raises(BlowUpError):
        session(row, scene, 1, 1, 1, end=BlowUpError("test"))  # session() waits for each write
    state = row.lead.simulation.state()
    found = lost_session(SceneArguments("pool"))
    assert offer(found).startswith("Enter continues small of ")
    assert found == Choice(scene, "large", {"gravity": 5.0}, resume=found.resume)
    row.lead.reset()
    row.lead.resume(found.resume)
    assert np.array_equal(row.lead.simulation.state()["x"], state["x"])
    assert lost_session(SceneArguments(scene, ("title=other",))) is None
    forget()
    assert not list(folder.iterdir()) and lost_session(SceneArguments("pool")) is None


@pytest.mark.parametrize("end", [None, ClosedError(), KeyboardInterrupt()])
def test_a_normal_end_removes_the_file(row, tmp_path, folder, end):
    def whole():
        session(row, str(tmp_path / "small.toml"), 3, end=end)

    if end:
        with pytest.raises(type(end)):
            whole()
    else:
        whole()
    assert row.lead.frames >= 3 and not list(folder.iterdir())


def test_a_running_session_is_not_offered(row, tmp_path, folder):
    with pytest.raises(BlowUpError):
        session(row, str(tmp_path / "small.toml"), 3, end=BlowUpError("test"))
    (path,) = folder.iterdir()
    assert lost_session(SceneArguments("pool")) is None
    # A file older than this process was written by another process with the same number.
    os.utime(path, (0.0, 0.0))
    assert lost_session(SceneArguments("pool")).resume == path
    path.write_bytes(b"PK damaged")
    os.utime(path, (0.0, 0.0))
    assert lost_session(SceneArguments("pool")) is None


def test_the_state_is_copied_and_written_in_another_thread(row, tmp_path, monkeypatch, others):
    """The simulation goes on while a file is written, and no other file is begun meanwhile."""
    scene, hold, threads = str(tmp_path / "small.toml"), threading.Event(), []
    savez = np.savez

    def slow(file, **state):
        threads.append(threading.current_thread())
        hold.wait(10.0)
        savez(file, **state)

    monkeypatch.setattr(np, "savez", slow)
    with pytest.raises(BlowUpError), session_file() as path:
        saver = Autosaver(path, Header.of(scene, "large"))
        run(row, Count(), 1, [saver])
        time = row.lead.simulation.time
        run(row, Count(), 5, [saver])
        hold.set()
        saver.writer.join()
        raise BlowUpError("test")
    assert len(threads) == 1 and threads[0] is not threading.main_thread()
    with np.load(lost_session(SceneArguments(scene)).resume) as state:
        assert state["time"] == time < row.lead.simulation.time
