"""The data of an event in words, for the reader of a replay."""

import re
from collections.abc import Iterator, Mapping
from typing import Any

from django.utils.translation import gettext as _
from django.utils.translation import gettext_lazy, gettext_noop, pgettext_lazy

from accounts.models import GUEST_NAMES
from robots.readiness_text import in_words as readiness
from sessions.leases import terms
from sessions.models import Session

# Left out: drawn on the map, the id of a row, or long and of no use to a reader.
LEFT_OUT = frozenset(
    {"pose", "sha256", "actionId", "id", "user", "by", "boot", "ranges", "photo", "lastSeq"}
)
LONGEST = 160
UNITS = {
    **dict.fromkeys(("seconds", "latency", "remaining"), "s"),
    **dict.fromkeys(("width", "height", "screen_width", "screen_height"), "px"),
    "minutes": "min",
}
# Fields whose values need no name.
PLAIN = frozenset(
    {"name", "detail", "reason", "text", "type", "why", "outcome", "method"}
    | {"choice", "state", "status", "word", "layout"}
)
FIELDS = {
    "number": gettext_lazy("number"),
    "step": gettext_lazy("step"),
    "deviation": gettext_lazy("deviation:"),
    "skipped": gettext_lazy("steps skipped"),
    "latency": gettext_lazy("from click or key to robot"),
    "aloud": gettext_lazy("read aloud"),
    "blind": gettext_lazy("blind to the condition"),
    "place": gettext_lazy("place in the queue"),
    "count": gettext_lazy("count"),
    "way": gettext_lazy("via"),
    "seconds": gettext_lazy("duration"),
    "remaining": gettext_lazy("time left"),
    "minutes": gettext_lazy("about"),
    "on": gettext_lazy("on"),
    "open": gettext_lazy("open"),
    "hidden": pgettext_lazy("a page", "hidden"),
    "touch": gettext_lazy("touch screen"),
    "width": gettext_lazy("width"),
    "height": gettext_lazy("height"),
    "screen_width": gettext_lazy("screen width"),
    "screen_height": gettext_lazy("screen height"),
    "density": gettext_lazy("pixel density"),
    "interface": gettext_lazy("interface"),
    "sight": gettext_lazy("the mirror:"),
    "bearing": gettext_lazy("bearing (rad)"),
    "distance": gettext_lazy("distance (m)"),
    "before": gettext_lazy("in front of it"),
    "sees": gettext_lazy("in view"),
}
CUES = {
    "wait_for_picture": gettext_lazy("waiting for video"),
    "leave_station": gettext_lazy("next: leave the station"),
    "go_to_checkpoint": gettext_lazy("next: go to checkpoint {k}"),
    "wrong_checkpoint": gettext_lazy("at a later checkpoint; {k} is next"),
    "photo_turn_left": gettext_lazy("photo: turn left"),
    "photo_turn_right": gettext_lazy("photo: turn right"),
    "photo_move": gettext_lazy("photo: move in front of the mirror"),
    "photo_ready": gettext_lazy("photo: ready to take"),
    "photo_review": gettext_lazy("photo: being reviewed"),
    "return_home": gettext_lazy("next: return to station"),
    "dock_now": gettext_lazy("next: dock"),
    "dock_hold": gettext_lazy("charger contact; release the controls"),
    "dock_again": gettext_lazy("contact lost; drive further into the station"),
    "docked_early": gettext_lazy("docked too early; checkpoint {k} is next"),
    "lost": gettext_lazy("the robot has lost its position"),
    "completed": gettext_lazy("completed"),
    "timed_out": gettext_lazy("out of time"),
    "ended": gettext_lazy("ended"),
}
# Values that are their own text.
PLAIN_VALUES = (
    *(gettext_noop("repeated"), gettext_noop("late"), gettext_noop("keyboard")),
    *(gettext_noop("mouse"), gettext_noop("touch"), gettext_noop("stick"), gettext_noop("gamepad")),
    *(gettext_noop("open"), gettext_noop("server"), gettext_noop("keep"), gettext_noop("skip")),
    *(gettext_noop("wide"), gettext_noop("upright"), gettext_noop("low"), gettext_noop("camera")),
    *(gettext_noop("microphone"), gettext_noop("dock"), gettext_noop("undock")),
    *(gettext_noop("photo"), gettext_noop("left"), gettext_noop("right"), gettext_noop("front")),
    gettext_noop("rear"),
)
VALUES = {
    **{value: gettext_lazy(value) for value in PLAIN_VALUES},
    "out_of_order": gettext_lazy("out of order"),
    "closed": pgettext_lazy("a door", "closed"),
    "direct": gettext_lazy("direct connection"),
    "again": gettext_lazy("retake"),
    "granted": gettext_lazy("allowed"),
    "denied": gettext_lazy("blocked"),
    "prompt": gettext_lazy("not asked yet"),
    "WAITING": gettext_lazy("waiting"),
    "RUNNING": gettext_lazy("in progress"),
    "FINISHED": pgettext_lazy("an action", "finished"),
    "FAILED": gettext_lazy("failed"),
    "CANCELLED": gettext_lazy("cancelled"),
    "goto": gettext_lazy("drive to a point"),
    "follow": gettext_lazy("follow a route"),
    "tilt": gettext_lazy("tilt the head"),
}
_KEY = re.compile(r"[A-Za-z0-9]+([_.-][A-Za-z0-9]+)+")


def in_words(data: Mapping[str, Any]) -> str:
    return " · ".join(part for part in _parts(data) if part)[:LONGEST]


def _parts(data: Mapping[str, Any]) -> Iterator[str]:
    cue = str(data.get("name") or data.get("word") or "").removeprefix("cue.")
    is_cue = cue in CUES
    if is_cue:
        yield str(CUES[cue]).replace("{k}", str(data.get("number") or ""))
    for name, value in data.items():
        if name in LEFT_OUT or value is None or (is_cue and name in {"name", "word", "number"}):
            continue
        text = _value_text(value, name)
        yield text if name in PLAIN or not text else f"{_field(name)} {text}"


def _field(name: str) -> str:
    return str(FIELDS.get(name, name.replace("_", " ")))


def _value_text(value: Any, field: str = "") -> str:
    if isinstance(value, bool):
        return _("yes") if value else _("no")
    if isinstance(value, Mapping):
        return ", ".join(
            f"{_field(name)} {_value_text(part, name)}" for name, part in value.items()
        )
    if isinstance(value, list | tuple):
        return ", ".join(_value_text(part) for part in value)
    if isinstance(value, int | float):
        number = f"{value:.3g}" if value % 1 else f"{value:.0f}"
        return f"{number} {UNITS.get(field, '')}".rstrip()
    if field == "reason":  # of a robot that is not ready, what it waits for
        return readiness(str(value).removeprefix(f"{terms.START}: ")) if value else ""
    return _word(str(value))


def _word(text: str) -> str:
    """Return a text with each known word translated, and keys such as `a_b` as words."""
    known = {**dict(Session.Outcome.choices), **VALUES, **GUEST_NAMES}
    if text in known:
        return str(known[text])
    return " ".join(
        str(known.get(word) or (re.sub(r"[_.-]", " ", word) if _KEY.fullmatch(word) else word))
        for word in text.split(" ")
    )
