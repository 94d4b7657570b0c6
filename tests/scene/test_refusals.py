"""Tests that invalid values of scenes are refused in one line that names the file and the key."""

import pytest

from msph.scene import SceneError, load_scene
from tests.scenes_kit import CUBE, TANK, write

# Text before a scene, and the refusal of the file.
FILES = {
    "[classic]\nduration = 2.0\n": "classic.duration: unknown key; 'duration' is a key of the",
    "[clasic]\nstiffness = 1.0\n": "clasic: unknown key; did you mean 'classic'?",
    "[classic]\nstifness = 1.0\n": "classic.stifness: unknown key; did you mean 'stiffness'?",
    "[[magnetism]]\nrate = 1.0\n": "magnetism: no such table; docs/scenes.md says what is",
    "variants = 3\n": "variants: is not a table of variants (got 3)",
    f"seed = {'9' * 5000}\n": "is not TOML: Exceeds the limit",
    f"title = {'[' * 5000}{']' * 5000}\n": "is not TOML: maximum recursion",
}
# Overrides of the cube of water, in which %s stands for the values, and the refusals by value.
OF_CUBE = {
    "%s": {
        "duration='long'": "duration: input should be a valid number (got 'long')",
        "duration=-1": "duration: input should be greater than 0 (got -1)",
        "duration=nan": "duration: input should be a finite number (got nan)",
        "title=3": "title: input should be a valid string (got 3)",
        "method='magic'": "method: input should be 'classic' or 'projection' (got 'magic')",
        "picture.view=sped": "picture.view: unknown view 'sped'",
        "box.size=[1, 0, 1]": "box.size.1: input should be greater than or equal to 0.001 (got 0)",
        "box.size=[1, 1]": "box.size",
        "box.size=[9999, 9999, 9999]": "surface.cell: 1,667 particles in a box of (9999, 9999,",
        "layers=[]": "layers: ",
        "water=[]": "water: ",
        "layers.0.mass=0": "layers.0.mass: input should be greater than 0.000000000001 (got 0)",
        "layers.0.mass=1e-9": "water: 500,000,000,000 particles in a box of (1, 1, 1) m need",
        "layers.0.mass=2000": "layers.0: particles of 1.26 m do not fit in the box",
        "layers.0.spacing=0.1": "layers.0: give either mass or spacing",
        "layers.0.spacing=1e-200": "layers.0.spacing: input should be greater than 0.00001",
        "layers.0.smoothing=1.5": "layers.0.smoothing: must be at least 1.7 for the method pro",
        "layers.9.mass=1": "--set: layers.9.mass: expected an index from 0 to 1, got '9'",
        "water.0.hi=[1, 0, 1]": "water.0.hi: has no volume",
        "water.0.hi=[1, 1.5, 1]": "water.0: reaches from (0, 0, 0) m to (1, 1.5, 1) m, outside",
        "water.0.layer=2": "water.0.layer: must be a layer's index from 0 to 1 (got 2)",
        "water.0.radius=0.1": "water.0: give either lo and hi, or centre and radius",
        "water.0.lo.0.a=1": "--set: water.0.lo.0.a: 'a' is not a parameter",
        "density=1e30": "density: input should be less than or equal to 100000",
        "projection.spray=1": "projection.spray: input should be less than or equal to 0.95",
        "projection.longest_step=1e-9": "projection.longest_step: ",
        "projection.velocity_iterations=1000000000": "projection.velocity_iterations: ",
        "projection.slip=false": "projection.slip: only viscous water can stick to walls",
        "surface.cell=2": "surface.cell: is too coarse for surface.smoothing = 1.6; at most 1.96",
        "duration": "--set: duration: expects key=value",
        "gravity=[0, -9.81": "--set: gravity: is not a TOML value: '[0, -9.81'",
        "variant=four": "--set: variant: unknown variant 'four'; known: none in this scene",
        "title.text=1": "title: input should be a valid string (got {'text': 1})",
    },
    "water=[{lo=[0, 0, 0], hi=[1, 0.5, 1]}, {%s}]": {
        "centre=[0.5, 0.5, 0.5], radius=0.1": "water.1: overlaps water.0",
    },
    "probes=[{name='a', kind=%s}]": {
        "'height'": "probes.0: a height probe needs at",
        "'height', at=[0.5, -0.1]": "probes.0.at: (0.5, -0.1) m is outside the box of (1, 1, 1) m",
        "'front', axis='up'": "probes.0.axis: input should be '+x', '-x', '+y', '-y', '+z' or '-z'",
        "'front', axis='+x', point=[0, 0, 0]": "probes.0.point: is not a key of front probes",
        "'front', axis='+x', window=0.1": "probes.0.window: is a key of pressure probes only",
        "'front', axis='+x'}, {name='a', kind='front', axis='-x'": "probes.1.name: there are",
        "'front', axis='+x'}, {name='a, b', kind='front'": "probes.1.name: string should",
        "'pressure', lo=[0.5, 0, 0]": "probes.0: a pressure probe needs point or lo and hi",
        "'pressure', point=[0.5, 1.2, 0]": "probes.0.point: (0.5, 1.2, 0) m is outside the box",
        "'flux', lo=[0.5, 0, 0], hi=[0.6, 0.2, 1]": "probes.0.hi: must equal lo on one axis",
        "'force', body='bodies.0'": "probes.0.body: the scene has no body bodies.0; known: none",
    },
    "camera.path=[%s]": {
        "{time=1.0}": "camera.path: needs two key frames",
        "{time=1.0}, {time=1.0}": "camera.path.1.time: must be later than 1 s",
        "{azimuth=3.0}, {time=1.0}": "camera.path.0.time: is required",
    },
    "inflows=[{%s}]": {
        "centre=[0.4, 0, 0.4], radius=0.1, speed=-1": "inflows.0.speed: is -1 at t = 0 s: must not",
        "centre=[0.4, 0, 0.4], radius=0.1, speed='1 - t'": "inflows.0.speed: is -0.002 at t = 1 s",
        "centre=[0.4, 0, 0.4], radius=0.1": "inflows.0: give a speed or a rate",
        "centre=[0.4, 0, 0.4], radius=0.1, speed='u'": "inflows.0.speed: unknown name 'u'",
        "centre=[0.4, 0, 0.4], radius=0.1, speed=1.7e308": "inflows.0.speed: must be -1e",
        "centre=[0.4, 0, 0.4], radius=0.1, speed='1e5*t'": "inflows.0.speed: is 2e+03 at t = 0.02",
        "centre=[2, 0, 0.4], radius=0.1, speed=1": "inflows.0: reaches from (1.9, 0, 0.3) to",
        "lo=[0, 0, 0], hi=[1, 1, 1], speed=1": "inflows.0.hi: lo and hi must differ along two axes",
    },
    "outflows=[{centre=[0.4, 0, 0.4]%s}]": {
        ", radius=0.1, rate=1e9": "outflows.0.rate: is 1e+09 at t = 0 s: must be 0 to 15708",
        ", radius=0.1, speed=1, rate=1": "outflows.0: give either speed or rate",
        "": "outflows.0: give either centre and radius, or lo and hi",
    },
}
# The same for the tank; " & " stands between two overrides.
OF_TANK = {
    "motion=[{%s}]": {
        "angle='4*sine(t)'": "motion.0.angle: unknown function 'sine'; did you mean 'sin'?",
        "angle='__import__(\"os\").nice(1)'": 'motion.0.angle: only names have numbers, not "__imp',
        "angle='x'": "motion.0.angle: unknown name 'x'; known: t, pi",
        "angle='4*'": "motion.0.angle: is not an expression: '4*'",
        "angle='9**4000000*0+t'": "motion.0.angle: '9**4000000*0+t' is not a number at t = 0 s",
        "angle='floor(1e300)**99999*floor(1e300)*0+t'": "motion.0.angle: 'floor(1e300)**99999*",
        "angle=\"f'{t:>99999999}'\"": "motion.0.angle: may hold numbers, names, functions",
        f"angle='{500 * 't+'}t'": "motion.0.angle: has 1001 characters",
        "angle='1e9*t'": "motion: the tank moves at ",
        "angle='90*sin(1e6*t)'": "motion: the tank moves at ",
        "angle='1e13*t'": "motion.0.angle: is 1.04e+12 at t = 0.104 s: must be -1e+12 to",
        "displacement=[0, 'sqrt(2 - t)', 0]": "motion.0.displacement.1: 'sqrt(2 - t)' is not",
        "axis=[0, 0, 0]": "motion.0.axis: has no direction",
        "table='nosuch.csv'": "motion.0.table: nosuch.csv: cannot be read: No such file",
        "table='a.csv', angle=3": "motion.0: give either a table, or displacement and angle",
    },
    "sway={angle=1, period=%s}": {"1e-320": "sway.period: input should be greater"},
    "bodies=[{centre=[1, 1, 1], radius=%s}]": {"1e154": "bodies.0.radius: must be -1e+12"},
    "wavemakers=[{stroke=0.1, period=%s}]": {
        "1e-5": "wavemakers.0.period: input should be greater than or equal to 0.01",
        "1e300": "wavemakers.0.period: input should be less than or equal to 1000",
        "1, position=0.01": "wavemakers.0.position: must be at least 0.099 m",
        "1, beach=1.9": "wavemakers.0: with its stroke and beach it does not fit in 2 m",
        "1}, {stroke=0.1, period=1": "wavemakers.1.end: wavemakers.0 is at this end",
        "1, beach=0.5}, {end='+x', stroke=0.1, period=1": "wavemakers.0.beach: there is a wave",
        "1}, {kind='flap', end='+x', stroke=0.9, period=1": "wavemakers.1.stroke: would tilt the",
    },
    "gravity=[0, 9.81, 0] & wavemakers=[{%s}]": {
        "stroke=0.1, period=1": "wavemakers: need gravity along -y",
    },
    "method=%s & wavemakers=[{stroke=0.1, period=1}]": {
        "classic": "wavemakers: the method classic has none; projection has",
    },
}


def cases(scene, refusals):
    """Returns scene, overrides and message of each refusal."""
    return [
        (scene, tuple(form.replace("%s", given).split(" & ")), message)
        for form, messages in refusals.items()
        for given, message in messages.items()
    ]


@pytest.mark.parametrize(
    ("text", "overrides", "message"),
    [
        *((text + CUBE, (), message) for text, message in FILES.items()),
        *cases(CUBE, OF_CUBE),
        *cases(TANK, OF_TANK),
    ],
    ids=lambda given: "" if "[box]" in given else str(given)[:60],
)
def test_an_invalid_scene_gives_one_line_with_file_and_key(tmp_path, text, overrides, message):
    with pytest.raises(SceneError) as error:
        load_scene(write(tmp_path, text, "scene.toml"), overrides)
    line = str(error.value)
    assert line.removeprefix("scene.toml: ").startswith(message) and "\n" not in line
    assert line.startswith(("scene.toml: ", "--set: "))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "is empty"),
        (b"\x89PNG\r\n\xff\xfe", "is not a text file"),
        (b"box = [", "is not TOML"),
        (b"\n[box]\nsize = [1, 1, 1]\n", "layers: is required (and 1 more)"),
    ],
)
def test_a_broken_file_gives_one_line(tmp_path, content, message):
    path = tmp_path / "broken.toml"
    path.write_bytes(content)
    with pytest.raises(SceneError) as error:
        load_scene(str(path))
    assert str(error.value).startswith("broken.toml: ") and message in str(error.value)


def test_a_missing_scene_suggests_the_nearest_name(tmp_path):
    with pytest.raises(SceneError, match="did you mean 'dam_break'"):
        load_scene("dam_brake")
    with pytest.raises(SceneError, match="is a folder"):
        load_scene(str(tmp_path))
