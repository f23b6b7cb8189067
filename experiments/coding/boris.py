"""Codings as BORIS projects (.boris): JSON as BORIS 7 to 9 writes it.

Read in BORIS's source (boris/config.py: EMPTY_PROJECT, behavioursFields, PJ_EVENTS_FIELDS;
boris/project_functions.py: open_project_json) and its test projects (tests/files/*.boris). A code
is a behavior of the ethogram, a point a "Point event", an interval a "State event", which BORIS
stores as two rows, its start and its stop, each with the modifiers' values in their order, divided
by |, "None" for one that was not chosen (boris/select_modifiers.py). The other codes of a group are
`excluded`. The coding of a session by a coder is an observation of the type LIVE, without a video.
"""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec
from django.utils.translation import gettext as _

from experiments.coding.scheme import BadCodingError, CodedEvent, ImportedCoding, clean, json_in
from experiments.definition.coding import Code

UNCHOSEN = "None"
KINDS = {"point": "Point event", "interval": "State event"}
# The parts of a project and an observation that are the same in all of them.
TEMPLATES = msgspec.json.decode(Path(__file__).with_name("boris_templates.json").read_bytes())


def to_boris(
    codes: Sequence[Code], observations: Mapping[str, Sequence[CodedEvent]], name: str, date: str
) -> bytes:
    """Return codings as a project of a name; `observations` has the events of each coding by the
    observation's name, and `date` is YYYY-MM-DDTHH:MM:SS.
    """
    known = {code.code: code for code in codes}
    project = TEMPLATES["project"] | {
        "project_date": date,
        "project_name": name,
        "behaviors_conf": {str(n): _behavior(code, codes) for n, code in enumerate(codes)},
        "observations": {
            key: TEMPLATES["observation"] | {"date": date, "events": _rows(events, known)}
            for key, events in observations.items()
        },
    }
    return msgspec.json.format(msgspec.json.encode(project), indent=1)


def _behavior(code: Code, codes: Sequence[Code]) -> dict[str, Any]:
    others = [one.code for one in codes if code.group and one.group == code.group and one != code]
    # as boris/add_modifier.py writes them; the type 0 is the choice of one value
    same = {"description": "", "type": 0, "ask at stop": False}
    modifiers = {
        str(n): {"name": one.name, **same, "values": list(one.values)}
        for n, one in enumerate(code.modifiers)
    }
    description = f"{code.name}: {code.description}" if code.description else code.name
    about = {"type": KINDS[code.kind], "key": code.key, "code": code.code}
    about |= {"description": description, "color": "", "category": ""}
    return about | {"modifiers": modifiers or "", "excluded": ",".join(others), "coding map": ""}


def _rows(events: Sequence[CodedEvent], codes: Mapping[str, Code]) -> list[list[Any]]:
    """Return the rows (time, subject, code, modifiers, comment) of events, in order. A stop comes
    before a start at the same moment, so that the rows of a code alternate.
    """
    rows: list[tuple[float, int, list[Any]]] = []
    for event in events:
        modifiers = codes[event.code].modifiers if event.code in codes else ()
        chosen = "|".join(event.modifiers.get(one.name, UNCHOSEN) for one in modifiers)
        rows.append((event.begin, 1, [event.begin, "", event.code, chosen, event.comment]))
        if event.end is not None:
            rows.append((event.end, 0, [event.end, "", event.code, chosen, ""]))
    return [row for _at, _order, row in sorted(rows, key=lambda row: row[:2])]


def from_boris(document: bytes, codes: Sequence[Code], wanted: str = "") -> ImportedCoding:
    """Return the events of the observation named `wanted`, and a sentence for each part that is not
    imported. The name is not needed where a project has one observation. A project that cannot be
    read, or without the observation, is a BadCodingError.
    """
    project = json_in(document)
    observations = project.get("observations") if isinstance(project, dict) else None
    if not isinstance(observations, dict) or not observations:
        raise BadCodingError([_("This is not a BORIS project with observations.")])
    if wanted not in observations and (wanted or len(observations) > 1):
        names = ", ".join(observations)[:1000]
        text = _("Name one of the project's observations: %(names)s.") % {"names": names}
        raise BadCodingError([text])
    observation = observations[wanted or next(iter(observations))]
    rows = observation.get("events") if isinstance(observation, dict) else None
    if not isinstance(rows, list):
        return [], [_("The observation has no list of events.")]
    problems: list[str] = []
    known = {name: code for code in codes for name in (code.name, code.code)}
    events = list(_events_of(rows, known, problems))
    return events, list(dict.fromkeys((*problems, *_left_out(observation))))


def _left_out(observation: dict[str, Any]) -> Iterator[str]:
    offset = observation.get("time offset")
    if isinstance(offset, int | float) and offset:
        yield _("The observation's time offset of %(n)g s is not applied.") % {"n": offset}
    parts = {
        "description": _("The observation's description is not imported."),
        "file": _("The observation's media files are not imported."),
        "independent_variables": _("The observation's independent variables are not imported."),
    }
    yield from (text for name, text in parts.items() if observation.get(name))


def _events_of(
    rows: list[Any], known: Mapping[str, Code], problems: list[str]
) -> Iterator[CodedEvent]:
    """Yield the events of rows (time, subject, code, modifier, comment); an interval is two rows of
    one subject and code.
    """
    begun: dict[tuple[str, str, str], tuple[float, str]] = {}
    for row in rows:
        if not isinstance(row, list) or len(row) < 3 or not isinstance(row[0], int | float):
            problems.append(_("A row that is not an event was left out."))
            continue
        time, (subject, name) = float(row[0]), (str(part) for part in row[1:3])
        modifier, comment = (str(part) if part else "" for part in [*row[3:5], "", ""][:2])
        comment = clean(comment)
        code = known.get(name)
        if code is None:
            problems.append(_("Behavior “%(name)s” is not a code of the scheme.") % {"name": name})
            continue
        if subject:
            problems.append(_("Subjects are not imported."))
        key, begin, end = (subject, name, modifier), time, None
        if code.kind == "interval":
            if key not in begun:
                begun[key] = (time, comment)
                continue
            begin, before = begun.pop(key)
            end, comment = time, " ".join(filter(None, (before, comment)))
        chosen = _modifiers_of(modifier, code, problems)
        yield CodedEvent(code.code, begin, end, comment, chosen)
    for _subject, name, _modifier in begun:
        problems.append(_("Behavior “%(name)s” starts but never stops.") % {"name": name})


def _modifiers_of(modifier: str, code: Code, problems: list[str]) -> dict[str, str]:
    """Return the values that a row has, by the names of the code's modifiers in their order."""
    chosen = {}
    for place, value in enumerate(modifier.split("|")):
        of = code.modifiers[place] if place < len(code.modifiers) else None
        if of is not None and value in of.values:
            chosen[of.name] = value
        elif value not in {"", UNCHOSEN}:
            text = _("“%(value)s” is not a value of a modifier of “%(name)s”.")
            problems.append(text % {"value": value, "name": code.name})
    return chosen
