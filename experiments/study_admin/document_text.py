"""What is stored of a drive as a document, in words."""

import json
from collections.abc import Iterator
from typing import Any

from django.utils.html import format_html, format_html_join
from django.utils.safestring import SafeString
from django.utils.translation import gettext

from experiments.builder.labels import CHOICES, LABELS
from robots.admin import NOTHING


def in_words(content: dict[str, Any], whole: Any = None) -> str | SafeString:
    """Return what a document says, a line each, and below it the whole as it is stored."""
    lines = [(name, value) for name, value in _lines(content) if name]
    if not lines:
        return NOTHING
    return format_html(
        "<ul>{}</ul><details><summary>{}</summary>{}</details>",
        format_html_join("", "<li>{}: {}</li>", lines),
        gettext("All values as stored"),
        as_json(content if whole is None else whole),
    )


def _lines(value: Any, name: str = "", key: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the values of a document with their names; lists of parts by their number."""
    if isinstance(value, dict):
        for inner, one in value.items():
            called = str(LABELS.get(inner, inner.replace("_", " ")))
            yield from _lines(one, f"{name} · {called}" if name else called, inner)
    elif isinstance(value, list):
        is_plain = not any(isinstance(one, dict | list) for one in value)
        if value:
            said = [str(_said(key, one)) for one in value]
            yield name, ", ".join(said) if is_plain else len(value)
    elif value is not None and value != "":
        yield name, _said(key, value)


def _said(key: str, value: Any) -> Any:
    if isinstance(value, bool):
        return gettext("yes") if value else gettext("no")
    if isinstance(value, float):
        return f"{value:.4g}"
    return CHOICES.get(key, {}).get(value, value)


def as_json(content: Any) -> str | SafeString:
    return (
        format_html("<pre>{}</pre>", json.dumps(content, indent=2, ensure_ascii=False))
        if content
        else NOTHING
    )
