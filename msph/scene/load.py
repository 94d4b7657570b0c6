"""Reading scenes: TOML file, variants and overrides to a checked Scene, and back to TOML."""

import contextlib
import copy
import os
import re
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import tomli_w
from pydantic import BaseModel, ValidationError

from msph.errors import did_you_mean
from msph.scene.check import check
from msph.scene.errors import SceneError
from msph.scene.library import find_scene
from msph.scene.meshes import resolve
from msph.scene.schema import Scene

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib


# Decimal points without a digit before or after them, which TOML does not allow.
BARE_POINT, BARE_END = re.compile(r"(?<![\w.])\.(?=\d)"), re.compile(r"(?<=\d)\.(?![\w.])")
# Name of a scene without a file, in messages.
TABLES = "scene"
# Largest number of characters of a value in a message.
MAX_VALUE = 80
# Errors of tomllib: for wrong syntax, for integers of thousands of digits, for deep nesting.
UNREADABLE = (tomllib.TOMLDecodeError, ValueError, RecursionError)


def load_scene(given: str | dict, overrides: Iterable[str] | dict[str, Any] = ()) -> Scene:
    """Returns the checked scene of a path, a shipped name, or the tables of a file, with overrides
    applied: texts "key=value", or values by key.

    A file may hold `variants`, named tables of changes, and `variant`, the name of the table
    to apply; an override `variant=NAME` selects another. Raises SceneError.
    """
    if isinstance(given, dict):
        data, where, folder = plain(given), TABLES, Path()
    else:
        path = find_scene(given)
        data, where, folder = read_toml(path), path.name, path.parent
    if isinstance(overrides, dict):
        settings = list(plain(overrides).items())
    else:
        settings = [parse_override(text) for text in overrides]
    data = choose_variant(data, settings, where)
    for key, value in settings:
        if key != "variant":
            assign(data, key, value, where="--set")
    for table, key in files_of(data):
        table[key] = resolve(table[key], folder)
    return checked(data, where)


def checked(data: dict[str, Any], where: str) -> Scene:
    """Returns the scene of the tables of a file. Raises SceneError."""
    try:
        scene = Scene.model_validate(data)
    except ValidationError as error:
        raise explain(error, where) from None
    check(scene, where)
    return scene


def with_probe(scene: Scene, probe: dict[str, Any], where: str) -> Scene:
    """Returns the scene with a further probe, given as its table. Raises SceneError."""
    data = scene.model_dump(mode="json", exclude_none=True)
    return checked({**data, "probes": [*data["probes"], plain(probe)]}, where)


def plain(value: Any) -> Any:
    """Returns a copy of tables and lists in which arrays, tuples and NumPy's numbers are lists and
    Python's numbers, and paths are texts."""
    if isinstance(value, dict):
        return {str(key): plain(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [plain(each) for each in value]
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    return value.tolist() if hasattr(value, "tolist") else value


def files_of(data: dict[str, Any]) -> list[tuple[dict[str, Any], str]]:
    """Returns the tables of a scene that name a file, each with the key of the name."""
    keys = {"bodies": "mesh", "container": "mesh", "motion": "table"}
    found = []
    for name, key in keys.items():
        given = data.get(name)
        tables = given if isinstance(given, list) else [given]
        found += [(t, key) for t in tables if isinstance(t, dict) and isinstance(t.get(key), str)]
    return found


def read_toml(path: Path) -> dict[str, Any]:
    """Returns the tables of a TOML file. Raises SceneError if it is not text, not TOML or empty."""
    try:
        # Editors on Windows may write a byte-order mark.
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise SceneError(path.name, "is not a text file") from None
    except OSError as error:
        raise SceneError(str(path), error.strerror or "cannot be read") from None
    try:
        data = tomllib.loads(text)
    except UNREADABLE as error:
        raise SceneError(path.name, f"is not TOML: {error}") from None
    if not data:
        raise SceneError(path.name, "is empty; `msph scenes pool` prints an example")
    return data


def parse_override(text: str) -> tuple[str, Any]:
    """Splits "box.size=[1, 1, 1]" into ("box.size", [1, 1, 1]); numbers may be .9 or 1., and
    a word needs no quotes. Raises SceneError."""
    key, sign, value = text.partition("=")
    key = key.strip()
    try:
        text.encode("utf-8")
    except UnicodeEncodeError:
        raise SceneError("--set", "is not valid Unicode text", ascii(text)) from None
    if not sign or not key:
        raise SceneError("--set", "expects key=value", text)
    value = value.strip()
    for written in (value, BARE_POINT.sub("0.", BARE_END.sub(".0", value))):
        with contextlib.suppress(*UNREADABLE):
            return key, tomllib.loads(f"value = {written}")["value"]
    if value.startswith(("[", "{", '"', "'")):
        raise SceneError("--set", f"is not a TOML value: {shortened(value)}", key)
    return key, value


def choose_variant(data: dict, settings: list[tuple[str, Any]], where: str) -> dict:
    """Returns the scene's tables with the chosen variant applied and without the keys `variant`
    and `variants`. Raises SceneError."""
    data = copy.deepcopy(data)
    variants = data.pop("variants", {})
    chosen = data.pop("variant", None)
    if not isinstance(variants, dict):
        raise SceneError(where, f"is not a table of variants (got {variants!r})", "variants")
    for key, value in settings:
        if key == "variant":
            chosen, where = value, "--set"
    if chosen is None:
        return data
    if str(chosen) not in variants:
        known = ", ".join(variants) or "none in this scene"
        raise SceneError(where, f"unknown variant {chosen!r}; known: {known}", "variant")
    change = variants[str(chosen)]
    if not isinstance(change, dict):
        raise SceneError(where, "is not a table", f"variants.{chosen}")
    return merge(data, change)


def merge(base: dict, change: dict) -> dict:
    """Returns `base` updated by `change`: tables are merged key by key, other values replaced."""
    result = dict(base)
    for key, value in change.items():
        old = result.get(key)
        if isinstance(old, dict) and isinstance(value, dict):
            value = merge(old, value)
        result[key] = value
    return result


def assign(data: Any, key: str, value: Any, where: str) -> None:
    """Sets a dotted key such as layers.0.mass in nested tables and lists. Raises SceneError."""
    *parents, last = key.split(".")
    for name in parents:
        if isinstance(data, list):
            data = data[_index(data, name, key, where)]
        elif isinstance(data, dict):
            if name not in data and last.isdigit():
                problem = f"{name} is not set in this scene: set the whole list, {name}=[...]"
                raise SceneError(where, problem, key)
            data = data.setdefault(name, {})
        else:
            raise SceneError(where, f"{name!r} has no parameters of its own", key)
    if isinstance(data, list):
        data[_index(data, last, key, where)] = value
    elif isinstance(data, dict):
        data[last] = value
    else:
        raise SceneError(where, f"{last!r} is not a parameter", key)


def _index(items: list, name: str, key: str, where: str) -> int:
    if not name.isdigit() or int(name) >= len(items):
        raise SceneError(where, f"expected an index from 0 to {len(items) - 1}, got {name!r}", key)
    return int(name)


def explain(error: ValidationError, where: str, model: type[BaseModel] = Scene) -> SceneError:
    """Returns the first error of a validation as one line: file, key, problem and hint."""
    details = error.errors()
    # A misspelt key is reported before the required key that it leaves missing.
    first = next((d for d in details if d["type"] == "extra_forbidden"), details[0])
    location = [part for part in first["loc"] if not str(part).startswith("function-")]
    key = ".".join(str(part) for part in location)
    kind, value = first["type"], first.get("input")
    if kind == "extra_forbidden":
        known = list(_model_at(location[:-1], model).model_fields)
        problem = f"unknown key; {did_you_mean(str(location[-1]), known)}"
        if len(location) > 1 and location[-1] in model.model_fields:
            problem = f"unknown key; {location[-1]!r} is a key of the whole file, not of this table"
        if len(location) == 1 and isinstance(value, dict | list) and "mean" not in problem:
            # A table of a feature that does not exist, such as [[magnetism]].
            known_tables = problem.removeprefix("unknown key; ")
            problem = f"no such table; docs/scenes.md says what is not possible; {known_tables}"
    elif kind == "missing":
        problem = "is required"
    else:
        problem = first["msg"][0].lower() + first["msg"][1:]
        if not isinstance(value, dict | list) or len(str(value)) < MAX_VALUE:
            problem += f" (got {shortened(value)})"
    others = len(details) - 1
    if others:
        problem += f" (and {others} more)"
    return SceneError(where, problem, key)


def shortened(value: Any) -> str:
    """Returns the representation of a value, cut to MAX_VALUE characters."""
    text = repr(value)
    return text if len(text) <= MAX_VALUE else text[:MAX_VALUE] + "..."


def _model_at(location: list, model: type[BaseModel]) -> type[BaseModel]:
    """Returns the section of the schema `model` at a location of the data."""
    for part in location:
        if isinstance(part, str) and part in model.model_fields:
            kind = model.model_fields[part].annotation
            arguments = getattr(kind, "__args__", (kind,))
            model = next(a for a in arguments if isinstance(a, type) and issubclass(a, BaseModel))
    return model


def to_toml(scene: Scene, note: str) -> str:
    """Returns the scene with all its parameters as TOML that loads to the same scene; note: text of
    the comment on the first line."""
    return f"# {note}\n" + tomli_w.dumps(scene.model_dump(mode="json", exclude_none=True))
