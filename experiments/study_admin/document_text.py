"""The documents that are stored with a drive, in words: what was assigned and what was recorded."""

import datetime
import json
import math
from collections.abc import Callable, Iterator, Mapping
from typing import Any

from django.utils.html import format_html, format_html_join
from django.utils.safestring import SafeString
from django.utils.translation import gettext, gettext_lazy as _, gettext_lazy as translated

from experiments.builder.labels import CHOICES, GUIDE, LABELS, Words
from experiments.research.study_access import shown_time
from robots.admin import NOTHING
from surveys.document_forms.guide import word_table

Written = Callable[[Any], str]


def _unit(unit: str, digits: int = 2, factor: float = 1.0) -> Written:
    return lambda value: f"{value * factor:.{digits}f}{unit}"


def time_text(at: datetime.datetime | None) -> str:
    return shown_time(at, "%H:%M:%S")


def _clock(stamp: float) -> str:
    return time_text(datetime.datetime.fromtimestamp(stamp, datetime.UTC))


def _duration(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes}:{rest:02d} min"


def _word(choices: Mapping[str, Words]) -> Written:
    return lambda value: str(choices.get(value, value))


# How the values of a drive's record are written. Stored are radians, shares from 0 to 1, and Unix
# times.
WRITTEN: dict[str, Written] = {
    "": str,
    "time": _clock,
    "duration": _duration,
    "m": _unit(" m"),
    "m/s": _unit(" m/s"),
    "ms": _unit(" ms", 0, 1000.0),
    "°": _unit("°", 0, 180.0 / math.pi),
    "°/s": _unit("°/s", 0, 180.0 / math.pi),
    "%": _unit(" %", 0, 100.0),
    "0.1 %": _unit(" %", 1, 100.0),
    "kbit/s": _unit(" kbit/s", 0, 0.001),
    "photo": _word({"": _("no answer"), "kept": _("kept"), "skipped": _("skipped")}),
    "channels": _word({"datachannel": _("direct connection"), "mqtt": _("server")}),
    **{name: _word(CHOICES[name]) for name in ("outcomes", "controllers", "actions")},
}
# What the record calls its fields, and how each is written.
RECORDED: dict[str, tuple[Words, Written]] = {
    row["field"]: (translated(row["label"]), WRITTEN[row["written"]])
    for row in word_table(__file__, "recorded.csv")
}


def assigned_in_words(assigned: dict[str, Any]) -> str | SafeString:
    return _listed({"condition": assigned.get("condition")}, assigned, {})


def recorded_in_words(content: dict[str, Any]) -> str | SafeString:
    shown = dict(content)
    if shown.get("started") is not None:
        # the engine stores Unix times; how long they took is what a reader compares
        shown["checkpoints"] = [at - shown["started"] for at in shown.get("checkpoints") or ()]
    return _listed(shown, content, RECORDED)


def _listed(
    content: dict[str, Any], whole: Any, known: Mapping[str, tuple[Words, Written]]
) -> str | SafeString:
    lines = [(name, value) for name, value in _lines(content, known) if name]
    if not lines:
        return NOTHING
    return format_html(
        "<ul>{}</ul><details><summary>{}</summary><pre>{}</pre></details>",
        format_html_join("", "<li>{}: {}</li>", lines),
        gettext("All values as stored"),
        json.dumps(whole, indent=2, ensure_ascii=False),
    )


def _lines(
    value: Any, known: Mapping[str, tuple[Words, Written]], name: str = "", key: str = ""
) -> Iterator[tuple[str, str]]:
    """Yield the values of a document with their names; lists of parts by their number."""
    if isinstance(value, dict):
        for inner, one in value.items():
            called = known[inner][0] if inner in known else LABELS.get(inner, inner)
            called = str(called).replace("_", " ")
            yield from _lines(one, known, f"{name} · {called}" if name else called, inner)
    elif isinstance(value, list):
        is_plain = not any(isinstance(one, dict | list) for one in value)
        if value:
            written = [_text(key, one, known) for one in value]
            yield name, ", ".join(written) if is_plain else str(len(value))
    elif value is not None and (value != "" or key == "photo"):
        yield name, _text(key, value, known)


def _text(key: str, value: Any, known: Mapping[str, tuple[Words, Written]]) -> str:
    if isinstance(value, bool):
        return gettext("yes") if value else gettext("no")
    if key in known:
        return known[key][1](value)
    if isinstance(value, float):
        return f"{math.degrees(value) if key in GUIDE.angles else value:.4g}"
    return str(CHOICES.get(key, {}).get(value, value))
