"""Output files of a recording: their kinds, names and checks."""

import re
from dataclasses import dataclass, field
from pathlib import Path

from msph.export import usd
from msph.export.files import PARAVIEW, BodyFiles
from msph.own_files import OutputError, place_of

VIDEO = (".mp4", ".mov", ".mkv", ".webm")
# Bodies as one file with a table of transforms, or as a file per frame.
BODIES = ".obj"
# Placeholder of the frame number in a file name.
NUMBER = re.compile(r"%0?[1-9]?d")
# Animated images, and the largest frame rate of a GIF, whose frames last at least 0.02 s.
ANIMATION = (".gif", ".webp")
GIF_FPS = 50.0
# Formats of the files of Outputs, by name.
KINDS = {
    "pictures": (*VIDEO, *ANIMATION, ".png"),
    "meshes": (".ply", ".obj", PARAVIEW),
    "particles": (".npz", ".csv", PARAVIEW),
    "bodies": (PARAVIEW, BODIES),
    "droplets": (".ply", PARAVIEW),
    "usd": usd.SUFFIXES,
}
# Formats that may have an alpha channel.
ALPHA = (".png", ".webp", ".webm")


@dataclass(frozen=True)
class Outputs:
    """Files to record. pictures: video (.mp4, .mov, .mkv, .webm), animation (.gif, .webp), still
    image (.png), or one .png per frame with a number such as %04d in its name; meshes of the
    surface (.ply, .obj, .vtu), particles (.npz checkpoint, .csv, .vtu), bodies (.vtu) and droplets
    of the spray (.ply, .vtu): with frame numbers; bodies (.obj) and usd (.usd, .usda, .usdc): one
    file. mesh_layer: meshes have the layer of each vertex."""

    pictures: list[Path] = field(default_factory=list)
    meshes: list[Path] = field(default_factory=list)
    particles: list[Path] = field(default_factory=list)
    bodies: list[Path] = field(default_factory=list)
    droplets: list[Path] = field(default_factory=list)
    usd: list[Path] = field(default_factory=list)
    mesh_layer: bool = False

    def all(self) -> list[Path]:
        return [path for name in KINDS for path in getattr(self, name)]

    @property
    def surface(self) -> bool:
        """True if files hold the surface."""
        return bool(self.meshes or self.droplets or self.usd)

    @property
    def sprayed(self) -> bool:
        """True if the spray is droplets, as in images, and meshes lack it."""
        return bool(self.droplets or self.usd) or not self.meshes

    @property
    def data(self) -> bool:
        """True if files hold states of the solver."""
        return self.surface or bool(self.particles or self.bodies)

    def names(self, first: int, frames: int) -> list[Path]:
        """Returns all files of a recording of `frames` frames, numbered from `first`."""
        found: list[Path] = []
        for path in self.all():
            numbers = range(first, first + frames) if numbered(path) else (first,)
            if path in self.bodies and kind(path) == BODIES:
                found += BodyFiles.files(path)[1:]
            found += (numbered_name(path, number) for number in numbers)
            if kind(path) == PARAVIEW:
                found.append(list_name(path, first))
        return found


def kind(path: Path) -> str:
    """Returns the file's suffix in lower case, which selects the format."""
    return path.suffix.lower()


def numbered_name(path: Path, number: int) -> Path:
    """Returns the path with the frame number filled in, if it has a placeholder."""
    return path.with_name(NUMBER.sub(lambda place: place[0] % number, path.name))


def list_name(path: Path, first: int) -> Path:
    """Returns the .pvd file of the .vtu files `path`; first: number of the first frame."""
    stem = NUMBER.sub("", path.stem).rstrip("_-") or "frames"
    return path.with_name(stem + (f"_from_{first}" if first else "") + ".pvd")


def numbered(path: Path) -> bool:
    """Returns True if the name has a frame number such as %04d."""
    return NUMBER.search(path.name) is not None


def check_outputs(
    outputs: Outputs, fps: float, alpha: bool = False, has_bodies: bool = True
) -> None:
    """Raises OutputError for outputs of an unknown or unfit kind. alpha: the images have an alpha
    channel."""
    for name, suffixes in KINDS.items():
        for path in getattr(outputs, name):
            check_output(path, suffixes, path in outputs.bodies and kind(path) == BODIES)
    paths = outputs.all()
    if len({place_of(path) for path in paths}) < len(paths):
        raise OutputError("the same output is named twice")
    for path in outputs.pictures:
        if alpha and kind(path) not in ALPHA:
            known = ", ".join(ALPHA)
            raise OutputError(f"{path}: no alpha channel (picture.alpha); with one: {known}")
    if fps > GIF_FPS and any(kind(p) == ".gif" for p in paths):
        raise OutputError(f"a GIF has at most {GIF_FPS:g} frames per second")
    if outputs.usd and not usd.available():
        raise OutputError(f"{outputs.usd[0]}: needs usd-core: pip install usd-core")
    if outputs.bodies and not has_bodies:
        raise OutputError(f"{outputs.bodies[0]}: the scene has no bodies")


def check_files(paths: list[Path], inputs: list[Path]) -> None:
    """Raises OutputError if a recording would write one of its files twice, or over an input."""
    read, seen = {place_of(path) for path in inputs}, set[Path]()
    for path in paths:
        place = place_of(path)
        if place in read:
            raise OutputError(f"{path}: is an input of this command; choose another name")
        if place in seen:
            raise OutputError(f"{path}: two outputs would write this file")
        seen.add(place)


def check_output(path: Path, suffixes: tuple[str, ...], single: bool) -> None:
    """Raises OutputError for a file name without one of these suffixes, or with a missing, extra or
    unexpected frame number. single: one file holds all frames, though others of the suffix do
    not."""
    if kind(path) not in suffixes:
        raise OutputError(f"{path}: unknown kind of file; known: {', '.join(suffixes)}")
    if len(NUMBER.findall(path.name)) > 1:
        raise OutputError(f"{path}: has more than one frame number")
    single = single or kind(path) in (*VIDEO, *ANIMATION, *usd.SUFFIXES)
    if not single and kind(path) in (*KINDS["meshes"], *KINDS["particles"]) and not numbered(path):
        raise OutputError(f"{path}: needs a frame number in its name, such as %04d")
    if single and numbered(path):
        what = "a video" if kind(path) in (*VIDEO, *ANIMATION) else "it"
        raise OutputError(f"{path}: {what} is one file and needs no frame number")
