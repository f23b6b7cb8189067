"""The contents of a pseudonymous dataset: allow_list.toml lists the fields of each kind of event
and message, with their forms (experiments/extraction/forms.py).

A field that is not listed does not leave. Every new kind of message or event and every new field
needs an entry, such as `withheld`; tests/unit/experiments/extraction/test_allow_list.py fails until
it has one. Ids leave as pseudonyms or not at all, times relative to the grant; hashes, names,
addresses and the counters of a robot's run never leave.

An identified dataset has events as they are stored.
"""

import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

import msgspec

from experiments.dataset import states
from experiments.dataset.columns import Column, declared
from experiments.dataset.levels import END_REASONS
from experiments.dataset.records import EventRecord
from experiments.definition.coding import CodingScheme
from experiments.definition.cues import CueKey
from experiments.definition.schema import Outcome
from experiments.extraction import forms
from experiments.extraction.forms import Form, Origin, Release, in_words, kept, words
from robots.api import messages as m
from sessions import protocol as p
from sessions.devices import OTHER as OTHER_DEVICE, SYSTEMS, TABLE_3_BROWSERS
from sessions.interfaces import INTERFACES
from sessions.leases.fault_side import MANAGER, WEB
from sessions.wizard.script import Deviation

Fields = Mapping[str, Form]

LISTED = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))
OS = frozenset({*SYSTEMS, OTHER_DEVICE})
BROWSERS = TABLE_3_BROWSERS | {OTHER_DEVICE}
EVENT_TYPES = get_args(m.Event.__annotations__["type"])
# The forms by their names in the list; those of the words of the code are here.
FORMS = {name: one for name, one in vars(forms).items() if isinstance(one, Form)} | {
    "action": words("", *(kind.__struct_config__.tag for kind in get_args(m.AnyAction))),
    "action_state": words(*get_args(m.ActionState)),
    "cue": words(*get_args(CueKey)),
    "deviation": words("", *get_args(Deviation)),
    "end_reason": words("", *END_REASONS),
    "event_type": words(*EVENT_TYPES),
    "input_method": words(*get_args(m.InputMethod)),
    "interface": words(*INTERFACES),
    "outcome": words(*get_args(Outcome)),
    "part": words(WEB, MANAGER),
    "role": words(*get_args(m.Action.__annotations__["role"])),
    "session_outcome": words(*get_args(Outcome), "moved"),
    "some_sides": words("ahead", "left", "behind", "right", is_several=True),
}


def _spread(listed: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    yield from ((name, value) for names, value in listed.items() for name in names.split())


def _form(listed: Any) -> Form:
    if isinstance(listed, str):
        limit, _, name = listed.rpartition(" ")
        return forms.private(FORMS[name]) if limit == "private" else FORMS[name]
    return words(*listed) if isinstance(listed, list) else forms.fields(_fields(listed))


def _fields(listed: Mapping[str, Any]) -> Fields:
    return {name: _form(one) for name, one in _spread(listed)}


def _message(name: str) -> type[msgspec.Struct]:
    return getattr(m, name, None) or getattr(p, name)


FORMS |= _fields(LISTED["forms"])
READERS: Mapping[type, type[msgspec.Struct]] = {
    m.State: states.StoredState,
    m.Pose: states.StoredPose,
    m.Velocity: states.StoredVelocity,
    m.Battery: states.StoredBattery,
    m.AppliedCommand: states.StoredCommand,
    p.PageNetwork: states.StoredSample,
}
MESSAGES: dict[type, Fields] = {
    _message(key): _fields(one) for key, one in LISTED["messages"].items()
}
for _kind, _reader in READERS.items():
    _read = (one.encode_name for one in msgspec.structs.fields(_reader))
    MESSAGES[_kind] = dict.fromkeys(_read, forms.in_columns) | MESSAGES[_kind]
KEPT_BACK = {*map(_message, LISTED["kept_back"].split()), *get_args(m.AnyAction)}
_NOTICES = {name: MESSAGES[kind] for name, kind in p.NOTICES.items() if kind in MESSAGES}
_EVENT, _DETAILS = MESSAGES[m.Event], _fields(LISTED["details"])
_TYPES = {kind: {**_EVENT, "detail": _DETAILS.get(kind, forms.text)} for kind in EVENT_TYPES}
EVENTS: Mapping[str, Mapping[str, Fields]] = {
    "robot": {"action": MESSAGES[m.ActionStatus], **_TYPES},
    **{
        source: (_NOTICES if source == "server" else {})
        | {kind: _fields(one) for kind, one in _spread(kinds)}
        for source, kinds in LISTED["events"].items()
    },
}
CODING_EDIT = _fields(LISTED["coding_edit"])


def coded(scheme: CodingScheme) -> Fields:
    every = (modifier for code in scheme.codes for modifier in code.modifiers)
    modifiers = forms.fields({modifier.name: words(*modifier.values) for modifier in every})
    codes = words(*(code.code for code in scheme.codes))
    return CODING_EDIT | {"code": codes, "modifiers": modifiers}


def released(
    source: str, kind: str, data: Mapping[str, Any], release: Release, origin: Origin
) -> dict[str, Any] | None:
    """Return the part of an event's data that leaves; None when no event of this kind does."""
    if release.choice.identified:
        return dict(data)
    listed = EVENTS.get(source, {}).get(kind)
    return None if listed is None else kept(listed, data, release, origin)


def event_columns() -> tuple[Column, ...]:
    """Return the columns of the events; the levels of a type are its sources and its fields."""
    found: dict[str, list[str]] = {}
    for source, kinds in EVENTS.items():
        for kind, listed in kinds.items():
            found.setdefault(kind, []).append(f"{source}: {in_words(listed)}".removesuffix(": "))
    types = {kind: "; or ".join(parts) for kind, parts in sorted(found.items())}
    columns = declared(EventRecord)
    return tuple(replace(one, levels=types) if one.name == "type" else one for one in columns)


def end_reason(reason: str, release: Release) -> str:
    """Return why a session ended; text of a person only where free text is kept."""
    return reason if release.choice.has_text or reason in END_REASONS else ""


def device(name: str, release: Release, known: frozenset[str]) -> str:
    """Return the word for an operating system or a browser; no public dataset has it."""
    if release.choice.public:
        return ""
    return name if release.choice.identified or name in known else ""
