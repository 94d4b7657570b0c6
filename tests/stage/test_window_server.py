"""The process of the window and those of waters, each with the other played by the test."""

import multiprocessing
import os
import signal
import threading
from types import SimpleNamespace

import numpy as np
import pytest
import taichi as ti

from msph.interrupts import InterruptedRun
from msph.picture.pixels import as_bytes
from msph.stage.choice import Choice
from msph.stage.link import Failed, Input, Over, Picture, Progress, Title, Wanted
from msph.stage.remote_window import RemoteWindow
from msph.stage.water_process import held_from_children
from msph.stage.window import ClosedError
from msph.stage.window_server import LostWaterError, WindowServer

SIZE = 4, 3


class Water:
    """A water's process that says what it is told to, one list of messages at each call."""

    def __init__(self, scene, *script, code=0):
        self.choice, self.script, self.code = Choice(scene, "auto"), list(script), code
        self.link, self.other = multiprocessing.Pipe()
        self.pixels = np.full(SIZE, sum(scene.encode()), np.int32)
        self.told, self.gone, self.failure = [], False, ""

    def heard(self):
        assert not self.gone, "a water that was left is not listened to"
        return self.script.pop(0) if self.script else []

    def tell(self, message):
        self.told.append(message)

    def leave(self):
        self.gone = True

    def end(self):
        self.gone = True
        return self.code


class Screen:
    """A window in which somebody presses these keys, one after the other."""

    def __init__(self, keys=(), frames=20):
        self.keys, self.frames = list(keys), frames
        self.shown, self.progress, self.closed, self.aspect = [], [], False, 1.5

    @property
    def open(self):
        return len(self.shown) < self.frames

    def presses(self):
        return [self.keys.pop(0)] if self.keys else []

    def down(self, key):
        return key == "a"

    def cursor(self):
        return np.array([0.5, 0.5])

    def processor_time(self):
        return 0.008

    def tell(self, share, doing):
        self.progress.append(share)

    def show(self, image):
        self.shown.append(image[0, 0])

    def mark(self, place):
        self.marked = place

    def close(self):
        self.closed = True


@pytest.fixture
def served(monkeypatch):
    """Serves a first water, those that it asks for by their names, and a screen."""
    monkeypatch.setattr("msph.stage.window_server.wait", lambda links, timeout: [])

    def serve(first, *others, screen=None):
        screen = screen or Screen()
        known = {water.choice.scene: water for water in others}
        titles = []

        def opened(title):
            titles.append(title)
            return screen

        server = WindowServer(first, lambda choice: known[choice.scene], opened)
        try:
            code = server.serve()
        finally:
            assert all(w.gone for w in (first, *server.left)) and screen.closed
        return SimpleNamespace(code=code, screen=screen, titles=titles)

    return serve


PICTURE = Picture(None, None)


def test_the_start_is_told_until_the_first_picture(served):
    pool = Water("pool", [Title("A pool")], [Progress(0.5, "compiling")], [PICTURE], [], [Over()])
    found = served(pool)
    assert found.code == 0 and found.titles == ["A pool"]
    assert found.screen.progress == [0.0, 0.5] and len(found.screen.shown) == 2
    assert [told.shown for told in pool.told] == [0, 1, 1]
    assert pool.told[0].display == 0.008, "before it chooses its quality"
    assert pool.told[-1].held == {"a"}


def test_the_old_water_plays_on_until_the_new_one_is_ready(served):
    wanted = [PICTURE, Wanted(Choice("drop", "auto"))]
    pool = Water("pool", [Title("A pool")], wanted, [], [PICTURE])
    drop = Water("drop", [Title("A drop")], [Progress(0.4, "compiling")], [PICTURE], [Over()])
    found = served(pool, drop)
    assert found.titles == ["A pool"], "one window for all"
    assert pool.told[-1].notice == "drop: 40 % ready"
    assert [told.shown for told in drop.told] == [0, 1], "those of its own"
    old, new = (water.pixels[0, 0] for water in (pool, drop))
    assert found.screen.shown == [old, old, old, new] and found.code == 0


def test_a_choice_takes_the_place_of_one_that_is_not_ready(served):
    first, second = (Wanted(Choice(name, "auto")) for name in ("drop", "still"))
    pool = Water("pool", [Title("")], [PICTURE, first], [second])
    drop = Water("drop", [Title("")], [PICTURE])
    still = Water("still", [Title("")], [PICTURE], [Over()])
    found = served(pool, drop, still)
    assert drop.gone and still.pixels[0, 0] in found.screen.shown


def test_a_water_that_cannot_be_made_ready_leaves_the_old_one(served):
    pool = Water(
        "pool", [Title("")], [PICTURE, Wanted(Choice("drop", "auto"))], *[[]] * 4, [Over()]
    )
    drop = Water("drop", [Failed("drop.toml: no water")], None, code=2)
    assert served(pool, drop).code == 0
    assert pool.told[-1].notice == "drop: drop.toml: no water"


def test_the_exit_code_is_that_of_the_water(served):
    assert served(Water("pool", [Title("")], [Failed("blew up")], None, code=1)).code == 1
    with pytest.raises(LostWaterError, match="pool: .* signal 9"):
        served(Water("pool", [Title("")], [PICTURE], None, code=-9))


def test_a_window_that_is_closed_ends_all(served):
    found = served(Water("pool", [Title("")], [PICTURE]), screen=Screen(frames=3))
    assert found.code == 0 and len(found.screen.shown) == 3


class TestRemoteWindow:
    """The window as the water sees it."""

    @pytest.fixture
    def ends(self):
        here, there = multiprocessing.Pipe()
        here.send(Input((), frozenset(), np.array([0.2, 0.3]), 1.6, 0))
        pixels = bytearray(4 * SIZE[0] * SIZE[1])
        return here, RemoteWindow(there, pixels, SIZE), pixels

    def test_it_passes_on_what_was_pressed(self, ends):
        here, window, _ = ends
        assert window.cursor() == pytest.approx([0.2, 0.3]) and window.aspect == 1.6
        for key in ("v", "h"):
            here.send(Input((key,), frozenset("a"), np.zeros(2), 1.0, 0, "drop: 40 % ready", 0.008))
        assert window.presses() == ["v", "h"] and window.presses() == []
        assert window.down("a") and not window.down("b", "c")
        assert window.notice() == "drop: 40 % ready" and window.display == 0.008
        window.ask(Choice("drop", "auto"))
        assert here.recv() == Wanted(Choice("drop", "auto"))

    def test_a_picture_waits_for_the_one_before(self, ends):
        here, window, pixels = ends
        image = ti.Vector.field(3, ti.f32, shape=SIZE)
        image.fill(1.0)
        window.mark(np.array([0.5, 0.5]))
        window.show(image)
        assert here.recv().marker == pytest.approx([0.5, 0.5])
        shown = as_bytes(np.frombuffer(pixels, np.int32).reshape(SIZE))
        assert (shown == 255).all()
        image.fill(0.0)
        here.send(Input((), frozenset(), np.zeros(2), 1.0, 0))
        here.send(Input(("v",), frozenset(), np.zeros(2), 1.0, 1))
        window.show(image)
        assert here.recv().marker is None and window.presses() == ["v"]
        assert (shown[..., :3] == 0).all() and (shown[..., 3] == 255).all()

    def test_a_window_that_is_gone_is_closed(self, ends):
        here, window, _ = ends
        here.close()
        image = ti.Vector.field(3, ti.f32, shape=SIZE)
        window.show(image)
        window.show(image)
        assert not window.open and window.presses() == []
        with pytest.raises(ClosedError):
            window.tell(0.5, "compiling")

    def test_none_is_there_where_it_was_closed_before(self):
        here, there = multiprocessing.Pipe()
        here.close()
        with pytest.raises(ClosedError):
            RemoteWindow(there, bytearray(48), SIZE)


def test_a_signal_waits_until_a_process_has_started():
    """One that another thread took had cut the start short; the child printed a traceback."""
    over, started = threading.Event(), False
    other = threading.Thread(target=over.wait)
    other.start()
    try:
        with pytest.raises(InterruptedRun), held_from_children():
            os.kill(os.getpid(), signal.SIGINT)
            over.wait(0.2)
            started = True
    finally:
        over.set()
        other.join()
    assert started
