"""Tests of a session in a window double: order of scenes, end of compilation, quality."""

import contextlib
from types import SimpleNamespace

import pytest

from msph import user_cache
from msph.errors import MsphError
from msph.fluid import world
from msph.options import QUALITIES
from msph.scene import load_scene
from msph.scene.library import shipped_scenes
from msph.stage import menu, session, trial
from msph.stage.choice import Choice, SceneArguments
from msph.stage.preparation import built_row
from msph.stage.session import Session
from msph.stage.window import ClosedError
from msph.taichi_internals import PLAIN
from tests.scenes_kit import write
from tests.stage.player_kit import Screen

pytestmark = pytest.mark.usefixtures("cache")
NAMES = list(shipped_scenes())


class Window(Screen):
    """Window double that is closed when its start screen is shown for the `closes`-th time."""

    def __init__(self, closes=None):
        super().__init__()
        self.closes, self.told = closes, []

    def begin(self, title):
        self.report("building the scene")

    def report(self, doing):
        self.told.append(doing)
        if len(self.told) == self.closes:
            raise ClosedError


class Here(contextlib.nullcontext):
    """Double of a Remote that runs simulations in this process."""

    def row(self, order, size, report):
        return built_row(order, size, report)


@pytest.fixture
def rounds(monkeypatch):
    """Returns a function that plays choices, each chosen while the previous one plays, and returns
    the scenes that were built and the messages."""

    def play(*choices, broken=()):
        built, said, following = [], [], iter(choices)

        def build(self, choice):
            if choice.scene in broken:
                raise MsphError("cannot be built")
            built.append(choice.scene)
            return SimpleNamespace(close=lambda: None), choice

        def end(self, row, choice):
            said.append(self.message)
            self.message = ""
            return next(following, None)

        monkeypatch.setattr(Session, "_build", build)
        monkeypatch.setattr(Session, "_play", end)
        monkeypatch.setattr(session, "Layout", lambda size: None)
        Session(Window(), Here(), SceneArguments("pool")).play("pool", "small")
        return built, said

    return play


def test_scenes_follow_each_other(rounds):
    assert rounds(Choice("drop", "auto"), Choice("still", "auto"))[0] == ["pool", "drop", "still"]


def test_a_scene_that_cannot_be_built_returns_to_the_previous_one(rounds):
    built, said = rounds(Choice("drop", "auto"), broken=("drop",))
    assert built == ["pool", "pool"] and said[-1] == "drop: cannot be built"
    with pytest.raises(MsphError):
        rounds(broken=("pool",))


def test_a_message_reports_the_restart_at_another_quality(rounds):
    _, said = rounds(Choice("pool", "medium"), Choice("drop", "medium"))
    assert said == ["", "pool begins again at quality medium", ""]


def test_thirty_presses_of_tab_build_one_further_scene(tmp_path, monkeypatch):
    asked, scene = [], write(tmp_path)
    monkeypatch.setattr(menu, "SETTLED", -1.0)

    class Recorded(Session):
        def _build(self, choice):
            asked.append(choice.scene)
            if len(asked) > 1:
                raise ClosedError
            return super()._build(choice)

    window = Window()
    window.pressed = ["Tab"] * 30
    with pytest.raises(ClosedError):
        Recorded(window, Here(), SceneArguments(scene)).play(scene, "large")
    # A scene that is not shipped precedes the first shipped scene.
    assert asked == [scene, NAMES[29 % len(NAMES)]]


@pytest.mark.skipif(PLAIN, reason="plain Taichi does not tell of kernels")
def test_closing_the_window_ends_compilation(tmp_path, monkeypatch):
    # As in a new process: with fields whose kernels exist, nothing would be compiled.
    monkeypatch.setattr(world, "_stock", [])
    scene, window = write(tmp_path), Window(closes=5)
    with pytest.raises(ClosedError):
        Session(window, Here(), SceneArguments(scene), frames=1).play(scene, "large")
    assert len(window.told) == 5 and window.image is None
    assert window.told[-1].startswith("compiling ")


@pytest.mark.parametrize(
    ("fast", "tried", "chosen"),
    [(4, 4, "finest"), (3, 4, "large"), (2, 3, "medium"), (1, 2, "small"), (0, 1, "small")],
)
def test_auto_selects_the_finest_quality_in_real_time(fast, tried, chosen, monkeypatch):
    """fast: number of qualities in real time. Qualities are tried from coarse to fine, up to the
    first one that is too slow."""
    found = []

    def factor(scene, quality, window, build):
        found.append(quality)
        return 2.0 if quality in QUALITIES[:fast] else 1.0

    monkeypatch.setattr(trial, "real_time_factor", factor)
    tried = list(QUALITIES[:tried])
    result = trial.finest_in_real_time(load_scene("pool"), "pool")
    assert result == chosen and found == tried
    # Each later start knows the result, unless the scene or the size of the window differs.
    assert trial.finest_in_real_time(load_scene("pool"), "pool") == chosen
    assert found == tried
    for changed in (("water=[{lo=[0, 0, 0], hi=[0.5, 0.3, 0.5]}]",), ("play.speed=0.5",)):
        trial.finest_in_real_time(load_scene("pool", changed), "pool")
    trial.finest_in_real_time(load_scene("pool"), "pool", SimpleNamespace(size=(640, 360)))
    assert found == 4 * tried
    fixed = load_scene("pool", ("variant=system-1",))
    assert trial.finest_in_real_time(fixed, "pool") == "large"
    assert found == 4 * tried


@pytest.mark.parametrize("stale", [7, "huge", "", ["small"]])
def test_a_stale_quality_is_measured_again(stale, monkeypatch):
    monkeypatch.setattr(trial, "real_time_factor", lambda *_: 0.5)
    scene = load_scene("pool")
    user_cache.remember(trial._key(scene, None), stale)
    assert trial.finest_in_real_time(scene, "pool") == "small"
    assert user_cache.recall(trial._key(scene, None), str) == "small"


@pytest.mark.parametrize(("slow", "known"), [(session.SLOW + 1.0, None), (0.0, "medium")])
def test_play_below_real_time_forgets_the_quality(slow, known, monkeypatch):
    window, arguments = Screen(), SceneArguments("pool")
    key = trial._key(load_scene("pool"), window)
    user_cache.remember(key, "medium")
    player = SimpleNamespace(
        pacer=SimpleNamespace(longest_slow=slow), close=lambda: None, next_choice=None
    )
    monkeypatch.setattr(session, "Player", lambda *_: player)
    monkeypatch.setattr(session, "run", lambda *_: None)
    row = SimpleNamespace(shows=[])
    Session(window, Here(), arguments)._play(row, Choice("pool", "auto", found="medium"))
    assert user_cache.recall(key, str) == known


def test_auto_omits_qualities_whose_particles_do_not_fit(monkeypatch):
    """Regression: the coarsest quality was chosen unchecked, and was an error."""
    spacing = load_scene("pillar").layers[0].spacing
    plate = f"bodies=[{{lo=[0.7, 0, 0.2], hi=[{0.7 + 1.3 * spacing}, 0.5, 0.4]}}]"
    monkeypatch.setattr(trial, "real_time_factor", lambda *_: 0.5)
    assert trial.finest_in_real_time(load_scene("pillar", (plate,)), "pillar") == "medium"
