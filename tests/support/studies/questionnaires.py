"""Questionnaires for tests, written as short as they can be."""

import datetime
import json

from surveys.definition import Definition
from surveys.problems import parse

NOW = datetime.datetime(2026, 3, 4, 12, 0, tzinfo=datetime.UTC)
AGREE = [
    {"value": value, "label": {"en": label}}
    for value, label in ((-1, "No"), (0, "Maybe"), (1, "Yes"))
]
OPTIONS = [
    {"value": name, "label": {"en": name.upper()}} for name in ("a", "b", "c", "d", "e", "f")
]


def item(kind: str, key: str, **more) -> dict:
    """Return an item in English; scales are `agree`, options a to f, those ranked a to c."""
    needs = {
        "likert": {"scale": "agree"},
        "grid": {"scale": "agree"},
        "single": {"options": OPTIONS},
        "multiple": {"options": OPTIONS},
        "ranking": {"options": OPTIONS[:3]},
        "slider": {"low": {"en": "Low"}, "high": {"en": "High"}},
    }
    return {
        "kind": kind,
        "key": key,
        "text": {"en": f"Text of {key}"},
        **needs.get(kind, {}),
        **more,
    }


def rows(*keys: str) -> list[dict]:
    return [{"key": key, "text": {"en": f"Row {key}"}} for key in keys]


def document(*pages: list[dict], **more) -> dict:
    """Return a whole questionnaire with these items a page."""
    written = [{"key": f"page{n}", "items": items} for n, items in enumerate(pages, start=1)]
    about = {
        "format": 1,
        "slug": "test",
        "version": 1,
        "title": {"en": "A test"},
        "languages": ["en"],
        "scales": {"agree": AGREE},
    }
    return {**about, "pages": written, **more}


def as_bytes(written: dict) -> bytes:
    return json.dumps(written).encode()


def defined(*pages: list[dict], **more) -> Definition:
    return parse(as_bytes(document(*pages, **more)))
