"""The rules of Psych-DS that its official validator reports as errors, for a folder.

Read from psych-ds/psychds-validator: the schema (`rules.files`, `rules.errors`,
`rules.compiled_metadata`), src/files/csv.ts and src/schema/applyRules.ts. Each rule has the
validator's code. The nightly tests run the validator itself (psychds_validator.py).
"""

import csv
import io
import json
import re
from collections.abc import Iterator
from pathlib import Path

FILE = re.compile(r"([a-z]+-[a-zA-Z0-9]+)(_[a-z]+-[a-zA-Z0-9]+)*_data\.csv")
REQUIRED = ("name", "description", "variableMeasured")
SCHEMA_ORG = {
    "http://schema.org",
    "http://schema.org/",
    "https://schema.org",
    "https://schema.org/",
}
# Words of schema.org (version 29) for the types that a dataset of ours has.
THING = {"name", "description", "identifier", "url", "subjectOf"}
WORK = THING | {
    "author", "citation", "funder", "keywords", "license", "schemaVersion", "text", "version",
}  # fmt: skip
WORDS = {
    "Dataset": WORK | {"variableMeasured"},
    "CreativeWork": WORK,
    "Person": THING | {"affiliation"},
    "Organization": THING,
    "PropertyValue": THING | {"maxValue", "minValue", "unitText", "value", "valueReference"},
}


def errors(folder: Path) -> list[str]:
    """Return everything that the validator would report as an error, and words that schema.org has
    not.
    """
    about = folder / "dataset_description.json"
    if not about.is_file():
        return ["MISSING_DATASET_DESCRIPTION"]
    if not (folder / "data").is_dir():
        return ["MISSING_DATA_DIRECTORY"]
    try:
        found = json.loads(about.read_bytes().decode("utf-8"))
    except ValueError as error:
        return [f"JSON_INVALID: {error}"]
    return [*_description(found), *_files(folder, found)]


def _description(found: dict) -> Iterator[str]:
    if found.get("@context") not in SCHEMA_ORG:
        yield "INVALID_JSONLD_FORMATTING: @context is not schema.org"
    if found.get("@type") != "Dataset":
        yield "INCORRECT_DATASET_TYPE"
    yield from (f"JSON_KEY_REQUIRED: {key}" for key in REQUIRED if not found.get(key))
    yield from _words(found)


def _words(node: object) -> Iterator[str]:
    for part in node if isinstance(node, list) else [node]:
        if not isinstance(part, dict):
            continue
        known = WORDS.get(part.get("@type", ""))
        if known is None:
            yield f"OBJECT_TYPE_MISSING: {part}"
            continue
        for key, value in part.items():
            if not key.startswith("@") and key not in known:
                yield f"INVALID_SCHEMAORG_PROPERTY: {part['@type']}.{key}"
            yield from _words(value)


def _files(folder: Path, found: dict) -> Iterator[str]:
    described = {entry["name"] for entry in found.get("variableMeasured", ())}
    paths = sorted((folder / "data").rglob("*_data.csv"))
    if not any(FILE.fullmatch(path.name) for path in paths):
        yield "MISSING_DATAFILE"
    seen: set[str] = set()
    for path in (path for path in folder.rglob("*") if path.is_file()):
        name = path.relative_to(folder).as_posix()
        if not path.stat().st_size:
            yield f"FILE_EMPTY: {name}"
        if name.casefold() in seen:
            yield f"twice, where capitals do not count: {name}"
        seen.add(name.casefold())
    for path in paths:
        if not FILE.fullmatch(path.name):
            yield f"FILENAME_KEYWORD_FORMATTING_ERROR: {path.name}"
        yield from _table(path, described)
    heads = {name for path in paths for name in next(csv.reader(path.open(encoding="utf-8")), ())}
    missing = sorted(described - heads)
    if missing:
        yield f"VARIABLE_MISSING_FROM_CSV_COLUMNS: {missing}"
    loose = set((folder / "data").rglob("*.csv")) - set(paths)
    yield from (f"EXTENSION_MISMATCH: {path.name}" for path in sorted(loose))


def _table(path: Path, described: set[str]) -> Iterator[str]:
    text = path.read_bytes().decode("utf-8").replace("\r\n", "\n").replace("\r", "\n")
    head, *rows = csv.reader(io.StringIO(text), strict=True)
    if not head or not all(head):
        yield f"CSV_HEADER_MISSING: {path.name}"
    if len(set(head)) < len(head):
        yield f"CSV_HEADER_REPEATED: {path.name}"
    if any(len(row) != len(head) for row in rows):
        yield f"CSV_HEADER_LENGTH_MISMATCH: {path.name}"
    missing = sorted(set(head) - described)
    if missing:
        yield f"CSV_COLUMN_MISSING_FROM_METADATA: {path.name}: {missing}"
