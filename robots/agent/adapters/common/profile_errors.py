"""Errors in a robot's profile, for its author: line, key, value, and what the value must be.

Pure. tomllib and msgspec know where an error is, but name it by Python types.
"""

import re
import tomllib
from collections.abc import Callable
from typing import Any

import msgspec

KeyPath = tuple[str | int, ...]  # such as ("sonars", 0, "y")
TYPES = {
    "float": "a number",
    "int": "a whole number",
    "str": "a text in quotes",
    "bool": "true or false",
    "array": "a list",
    "object": "a section",
}
BOUNDS = {">": "above", ">=": "of at least", "<": "below", "<=": "of at most"}
# What msgspec says.
PLACE = re.compile(r" - at `\$\.?(.*)`$")
PART = re.compile(r"(\w+)|\[(\d+)\]")
EXPECTED = re.compile(r"Expected `(\w+)(?: \| null)?`(?: of length (\d+)| ([<>]=?) ([\d.]+))?")
LACKS = re.compile(r"Object (missing required|contains unknown) field `(\w+)`")
# What tomllib says, and a file's lines.
AT_LINE = re.compile(r" \(at line (\d+), column \d+\)$")
KEY = re.compile(r"\s*([\w-]+)\s*=\s*([^#]*)")
HEADER = re.compile(r"\s*\[+\s*([\w-]+)\s*\]+")
NUMBER = re.compile(r"([+-]?)(\d*)[.,]?(\d*)")


def advice(found: Any, wanted: str) -> str:
    """Return how to write a number that has a comma, quotes or no zero, else ""."""
    number = NUMBER.fullmatch(found.strip()) if isinstance(found, str) else None
    if number is None or not (number[2] or number[3]) or "number" not in wanted:
        return ""
    if number[3] and "whole" in wanted:
        return ""
    return f": write {number[1]}{number[2] or 0}{number[3] and '.' + number[3]}"


def unreadable(text: str, error: tomllib.TOMLDecodeError) -> str:
    """Return why a file is no TOML, with the line that is none."""
    at = AT_LINE.search(str(error))
    if at is None:
        return str(error)
    number = int(at[1])
    line = text.splitlines()[number - 1]
    key = KEY.match(line)
    found = key[2].strip() if key is not None else ""
    if key is not None and (how := advice(found, "a number")):
        return f"line {number}: {key[1]} must be a number, not {found}{how}"
    return f"line {number}, {line.strip()!r}: {AT_LINE.sub('', str(error))}"


def refused(
    text: str, content: Any, error: msgspec.ValidationError, named: Callable[[str], str] = str
) -> str:
    """Return what the value must be that msgspec refuses in `content`, converted from `text`;
    `named` gives the file's key of a field.
    """
    place, lacks = PLACE.search(str(error)), LACKS.search(str(error))
    fields: KeyPath = tuple(
        int(index) if index else name
        for name, index in (PART.findall(place[1]) if place is not None else ())
    )
    keys = tuple(part if isinstance(part, int) else named(part) for part in fields)
    if lacks is not None:
        key = named(lacks[2])
        line = line_of(text, (*keys, key)) or line_of(text, keys)
        whole = f"[{keys[0]}]" if len(keys) == 1 else _name(keys) or "the file"
        return f"{line}{whole} has no {'key ' * (lacks[1][0] == 'c')}{key}"
    found = content
    for part in fields:
        found = found[part]
    wanted = _wanted(str(error))
    return f"{line_of(text, keys)}{_name(keys)} must be {wanted}, not {shown(found, wanted)}"


def shown(found: Any, wanted: str) -> str:
    """Return a value as it is written in TOML, with advice where it should be a number."""
    written = str(found).lower() if isinstance(found, bool) else repr(found)
    return f"{written}{advice(found, wanted)}"


def _wanted(message: str) -> str:
    expected = EXPECTED.search(message)
    if expected is None:
        return PLACE.sub("", message)
    kind, length, sign, bound = expected.groups()
    if length:
        return f"{length} numbers"
    return TYPES.get(kind, kind) + (f" {BOUNDS[sign]} {float(bound):g}" if sign else "")


def _name(keys: KeyPath) -> str:
    match keys:
        case (str(section), int(index), str(key)):
            return f"[[{section}]] number {index + 1}, {key},"
        case (str(section), int(index), *_):
            return f"{section} number {index + 1}"
        case (str(section), str(key)):
            return f"[{section}] {key}"
        case _:
            return " ".join(str(key) for key in keys)


def line_of(text: str, keys: KeyPath) -> str:
    """Return "line 12: " for the first line of a key, or else its section, "" when not found."""
    section, index, key = "", -1, ""
    for number, line in enumerate(text.splitlines(), 1):
        if header := HEADER.match(line):
            index = index + 1 if header[1] == section else 0
            section, key = header[1], ""
        elif assigned := KEY.match(line):
            key = assigned[1]
        else:
            continue
        here = {(section, key), (section, index, key)} if section else {(key,)}
        if not key:
            here = {(section,), (section, index)}
        if keys in here or (not section and keys[:1] == (key,) and len(keys) > 1):
            return f"line {number}: "
    return ""
