"""Parameter objects to and from plain mappings and YAML documents, strictly and with every key explained.

Any frozen dataclass of numbers, strings, booleans, tuples and further such dataclasses is a document: a
scenario, a line, the case of a solver. Field annotations say what a value may be; the docstring beneath a
field becomes the comment above its key.
"""

from __future__ import annotations

import ast
import dataclasses
import inspect
import json
import math
import textwrap
import types
import typing
from functools import cache
from pathlib import Path
from typing import Any

from heave_env.parameters import name_hint


def to_mapping(parameters: Any) -> dict[str, Any]:
    """A parameter object as nested plain dictionaries, lists, strings and numbers."""
    return {item.name: _plain(getattr(parameters, item.name)) for item in dataclasses.fields(parameters)}


def _plain(value: Any) -> Any:
    if dataclasses.is_dataclass(value):
        return to_mapping(value)
    return [_plain(item) for item in value] if isinstance(value, tuple) else value


def from_mapping(kind: type, mapping: Any, path: str = "") -> Any:
    """Builds a parameter object from a nested mapping: no unknown key, no missing one, no wrong type.

    Args:
        kind: The dataclass to build.
        mapping: Its fields by name.
        path: Where the mapping stands in its document, for the complaint.

    Raises:
        ValueError: If a key is unknown or missing, or a value is impossible.
    """
    if not isinstance(mapping, dict):
        raise ValueError(f"{path or kind.__name__} must be a mapping of keys to values, got {mapping!r}")
    known = {item.name: item for item in dataclasses.fields(kind)}
    where = f"{path}." if path else ""
    for key in mapping:
        if key not in known:
            hint = name_hint(key, known, f"known keys: {', '.join(known)}")
            raise ValueError(f"unknown key '{where}{key}'; {hint}")
    for key, item in known.items():
        required = item.default is dataclasses.MISSING and item.default_factory is dataclasses.MISSING
        if required and key not in mapping:
            raise ValueError(f"missing key '{where}{key}'; give it a value")
    hints = _hints(kind)
    converted = {key: _converted(hints[key], value, where + key) for key, value in mapping.items()}
    try:
        built = kind(**converted)
    except TypeError:  # an object that compares before it looks at types; the sentence below says it better
        built = None
    for key, value in converted.items():
        _check_type(hints[key], value, where + key)
    return kind(**converted) if built is None else built


@cache
def _hints(kind: type) -> dict[str, Any]:
    return typing.get_type_hints(kind)


def _without_none(hint: Any) -> Any:
    """The annotation `X` of an optional `X | None`, others as they are."""
    if typing.get_origin(hint) in (typing.Union, types.UnionType):
        inner = [item for item in typing.get_args(hint) if item is not type(None)]
        return inner[0] if len(inner) == 1 else hint
    return hint


def _is_optional(hint: Any) -> bool:
    return type(None) in typing.get_args(hint)


def _converted(hint: Any, value: Any, path: str) -> Any:
    """The value as its annotation wants it: mappings built, lists as tuples, whole numbers as floats."""
    if value is None:
        return None
    hint = _without_none(hint)
    if dataclasses.is_dataclass(hint):
        return from_mapping(typing.cast(type, hint), value, path)
    if typing.get_origin(hint) is tuple:
        if not isinstance(value, (list, tuple)):
            raise ValueError(f"{path} must be a list, got {value!r}")
        inner = typing.get_args(hint)[0]
        return tuple(_converted(inner, item, f"{path}[{i}]") for i, item in enumerate(value))
    # YAML reads 5 as an integer: a length of 5 is a length of 5.0, whatever its spelling.
    if hint is float and isinstance(value, int) and not isinstance(value, bool):
        return float(value)
    return value


def _check_type(hint: Any, value: Any, path: str) -> None:
    if value is None and _is_optional(hint):
        return
    hint = _without_none(hint)
    if typing.get_origin(hint) is tuple:
        for i, item in enumerate(value):
            _check_type(typing.get_args(hint)[0], item, f"{path}[{i}]")
        return
    wanted = {
        float: ("a finite number", isinstance(value, float) and math.isfinite(value)),
        int: ("a whole number", isinstance(value, int) and not isinstance(value, bool)),
        bool: ("true or false", isinstance(value, bool)),
        str: ("a word", isinstance(value, str)),
    }.get(hint)
    if wanted is not None and not wanted[1]:
        raise ValueError(f"{path} must be {wanted[0]}, got {value!r}")


def with_value(parameters: Any, path: str, value: Any) -> Any:
    """A copy with the value at a dotted path replaced, such as `winch.time_constant`.

    An entry of a list is reached by its number from 0, or by its first value if that is a word:
    `sensors.payload_heave.noise_std`, `line.sections.0.length`.

    Raises:
        ValueError: If the path leads nowhere or the value is impossible.
    """
    return with_values(parameters, {path: value})


def with_values(parameters: Any, values: dict[str, Any]) -> Any:
    """A copy with the values at several dotted paths replaced at once: only the whole must make sense.

    Raises:
        ValueError: If a path leads nowhere or a value is impossible.
    """
    mapping = to_mapping(parameters)
    owner = getattr(parameters, "name", None) or type(parameters).__name__
    for path, value in values.items():
        _replace(mapping, path, value, owner)
    return from_mapping(type(parameters), mapping)


def _replace(mapping: dict[str, Any], path: str, value: Any, owner: str) -> None:
    keys = path.split(".")
    place: Any = mapping
    for depth, key in enumerate(keys):
        entries = _entries(place)
        if key not in entries:
            hint = name_hint(key, entries, f"known keys here: {', '.join(entries) or 'none'}")
            raise ValueError(f"unknown key {path!r}: there is no {key!r}; {hint}")
        if depth < len(keys) - 1:
            place = entries[key]
            if place is None:
                raise ValueError(f"cannot set {path!r}: {key!r} is null in {owner!r}")
        elif isinstance(place, dict):
            place[key] = value
        elif isinstance(entries[key], dict):
            example = list(entries[key])[-1]
            raise ValueError(f"{path!r} names a whole entry; name one of its values, as {path}.{example}")
        else:
            place[int(key)] = value


def differences(one: Any, other: Any, path: str = "") -> dict[str, Any]:
    """The values of one mapping, by dotted path, that are not those of another of the same structure.

    Raises:
        ValueError: If a part is null, or a list longer, in one of them alone.
    """
    if isinstance(one, list) and isinstance(other, list) and [*map(type, one)] == [*map(type, other)]:
        one, other = ({str(i): item for i, item in enumerate(items)} for items in (one, other))
    if isinstance(one, dict) and isinstance(other, dict) and one.keys() == other.keys():
        found: dict[str, Any] = {}
        for key, value in one.items():
            found |= differences(value, other[key], f"{path}.{key}" if path else key)
        return found
    if isinstance(one, (dict, list)) or isinstance(other, (dict, list)):
        raise ValueError(f"{path!r} is given in one of two scenarios alone; give it in both or in none")
    return {} if one == other else {path: one}


def put(mapping: dict[str, Any], path: str, value: Any) -> None:
    """Replaces the number at a dotted path of a mapping that was made by `to_mapping`.

    Raises:
        ValueError: If there is no number at that path.
    """
    *way, last = path.split(".")
    place: Any = mapping
    for key in way:
        place = _entries(place).get(key)
    if not isinstance(place, dict) or not isinstance(place.get(last), float):
        raise ValueError(f"there is no number {path!r} to draw; name one that the scenario gives a value")
    place[last] = value


def _entries(place: Any) -> dict[str, Any]:
    """What can be reached from a place in a mapping, by key."""
    if isinstance(place, dict):
        return place
    if not isinstance(place, list):
        return {}
    firsts = [next(iter(item.values()), None) if isinstance(item, dict) else None for item in place]
    named = {first: place[i] for i, first in enumerate(firsts) if isinstance(first, str)}
    return named | {str(i): item for i, item in enumerate(place)}


@cache
def field_docs(kind: type) -> dict[str, str]:
    """The docstring beneath each field of a parameter class, as one line each."""
    tree = ast.parse(textwrap.dedent(inspect.getsource(kind))).body[0]
    assert isinstance(tree, ast.ClassDef)
    docs = {}
    for node, following in zip(tree.body, tree.body[1:], strict=False):
        if (
            isinstance(node, ast.AnnAssign)
            and isinstance(node.target, ast.Name)
            and isinstance(following, ast.Expr)
            and isinstance(following.value, ast.Constant)
            and isinstance(following.value.value, str)
        ):
            docs[node.target.id] = " ".join(following.value.value.split())
    return docs


def to_yaml(parameters: Any, heading: str) -> str:
    """A parameter object as YAML, each key explained by a comment; `read_mapping` takes it back.

    Args:
        parameters: The object.
        heading: The first lines, without comment signs.
    """
    lines = [f"# {line}" for line in heading.splitlines()]
    return "\n".join([*lines, *_yaml_lines(type(parameters), to_mapping(parameters), "")]) + "\n"


def _yaml_lines(kind: type, mapping: dict[str, Any], indent: str, *, explained: bool = True) -> list[str]:
    docs, hints = (field_docs(kind) if explained else {}), _hints(kind)
    lines: list[str] = []
    after_part = False
    for key, value in mapping.items():
        inner = _without_none(hints[key])
        item_kind = typing.get_args(inner)[0] if typing.get_origin(inner) is tuple else inner
        if not dataclasses.is_dataclass(item_kind):
            lines += [""] if after_part and not indent else []
            after_part = False
            lines += [*_comment(docs.get(key, ""), indent), f"{indent}{key}: {_scalar(value)}"]
            continue
        after_part = True
        summary = docs.get(key) or (inspect.getdoc(item_kind) or "").splitlines()[0]
        if explained:
            lines += [*([""] if not indent else []), *_comment(summary, indent)]
        nested = typing.cast(type, item_kind)
        if isinstance(value, dict):
            lines.append(f"{indent}{key}:")
            lines += _yaml_lines(nested, value, indent + "  ", explained=explained)
        elif value:
            lines.append(f"{indent}{key}:")
            for i, item in enumerate(value):
                # Only the first entry of a list is explained; the others have the same keys.
                inside = _yaml_lines(nested, item, indent + "    ", explained=explained and i == 0)
                first = next(j for j, line in enumerate(inside) if not line.lstrip().startswith("#"))
                inside[first] = f"{indent}  - {inside[first].lstrip()}"
                lines += inside
        else:
            lines.append(f"{indent}{key}: {'null' if value is None else '[]'}")
    return lines


def _comment(doc: str, indent: str) -> list[str]:
    return textwrap.wrap(doc, 100, initial_indent=f"{indent}# ", subsequent_indent=f"{indent}# ")


def _scalar(value: Any) -> str:
    # JSON's scalars and flow lists are YAML's too; Python's repr of a float keeps every digit, but YAML
    # 1.1 wants a point and a signed exponent to see a float in it.
    if isinstance(value, list):
        return f"[{', '.join(_scalar(item) for item in value)}]"
    if isinstance(value, float):
        text = repr(value)
        if "e" in text and "." not in text:
            text = text.replace("e", ".0e")
        return text
    return json.dumps(value, ensure_ascii=False)


def read_mapping(path: str | Path, what: str) -> Any:
    """The content of a YAML file.

    Args:
        path: The file.
        what: What it should hold, for the complaint, as `scenario`.

    Raises:
        ValueError: If the file cannot be read or is no YAML.
    """
    import yaml

    try:
        return yaml.safe_load(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise ValueError(f"cannot read {what} file {str(path)!r}: {error.strerror}") from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        detail = " ".join(str(error).split())
        raise ValueError(f"{str(path)!r} is not valid YAML: {detail}") from error
