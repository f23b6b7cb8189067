"""Codings as ELAN annotation files (.eaf), version 3.0 of the format.

The schema is http://www.mpi.nl/tools/elan/EAFv3.0.xsd. A code is a tier, named as the code, with
the coder as its annotator. ELAN has no points: a point is an annotation of a millisecond on a tier
of the type "point", and is read as its beginning. The annotation's text is the comment. A modifier
is a tier below that of its code, named `code@modifier`, with its value for each event. No video is
linked, because the site stores none.
"""

from collections.abc import Iterator, Sequence
from itertools import count
from xml.etree import ElementTree as ET

from django.utils.translation import gettext as _
from msgspec import structs

from experiments.coding.scheme import BadCodingError, CodedEvent, ImportedCoding, clean
from experiments.definition.coding import Code, Modifier
from surveys.document_forms.problem_text import sentences
from surveys.documents import BadDefinitionError
from surveys.importing import safe_xml

SCHEMA = {
    "xmlns:xsi": "http://www.w3.org/2001/XMLSchema-instance",
    "xsi:noNamespaceSchemaLocation": "http://www.mpi.nl/tools/elan/EAFv3.0.xsd",
}
POINT_MS = 1
MAX_DIGITS = 12  # of a time in milliseconds
MODIFIER, ASSOCIATION = "modifier", "Symbolic_Association"
Slotted = tuple[CodedEvent, list[str]]  # an event with its two time slots


def to_eaf(codes: Sequence[Code], events: Sequence[CodedEvent], coder: str, date: str) -> bytes:
    """Return a coding as a file with a tier for each code, even without events. The events are in
    order, `coder` is a pseudonym, `date` is ISO 8601 with a time zone, as the schema requires.
    """
    about = {"AUTHOR": coder, "DATE": date, "FORMAT": "3.0", "VERSION": "3.0"}
    root = ET.Element("ANNOTATION_DOCUMENT", about | SCHEMA)
    header = ET.SubElement(root, "HEADER", {"MEDIA_FILE": "", "TIME_UNITS": "milliseconds"})
    last = ET.SubElement(header, "PROPERTY", {"NAME": "lastUsedAnnotationId"})
    slots = _time_order(root, events)
    numbers = count(1)
    for code in codes:
        own = [one for one in zip(events, slots, strict=True) if one[0].code == code.code]
        _tiers(root, code, own, coder, numbers)
    last.text = str(next(numbers) - 1)
    aligned = {"TIME_ALIGNABLE": "true"}
    associated = {"CONSTRAINTS": ASSOCIATION, "TIME_ALIGNABLE": "false"}
    for name, more in (("point", aligned), ("interval", aligned), (MODIFIER, associated)):
        named = {"GRAPHIC_REFERENCES": "false", "LINGUISTIC_TYPE_ID": name}
        ET.SubElement(root, "LINGUISTIC_TYPE", named | more)
    text = "1-1 association with a parent annotation"
    ET.SubElement(root, "CONSTRAINT", {"DESCRIPTION": text, "STEREOTYPE": ASSOCIATION})
    ET.indent(root)
    document: bytes = ET.tostring(root, "UTF-8", xml_declaration=True)
    return document + b"\n"


def _time_order(root: ET.Element, events: Sequence[CodedEvent]) -> list[list[str]]:
    """Write the time slots in order; return the names of the two of each event."""
    order = ET.SubElement(root, "TIME_ORDER")
    times = []
    for place, event in enumerate(events):
        begin = round(event.begin * 1000)
        end = begin + POINT_MS if event.end is None else max(round(event.end * 1000), begin + 1)
        times += [(begin, place, 0), (end, place, 1)]
    slots = [["", ""] for _event in events]
    for number, (time, place, which) in enumerate(sorted(times), start=1):
        slots[place][which] = f"ts{number}"
        ET.SubElement(order, "TIME_SLOT", {"TIME_SLOT_ID": f"ts{number}", "TIME_VALUE": str(time)})
    return slots


def _tiers(
    root: ET.Element, code: Code, events: Sequence[Slotted], coder: str, numbers: Iterator[int]
) -> None:
    """Write the tier of a code and those of its modifiers."""
    tier = _tier(root, code.code, coder, {"LINGUISTIC_TYPE_REF": code.kind})
    names = [f"a{next(numbers)}" for _event in events]
    for name, (event, slots) in zip(names, events, strict=True):
        where = {"TIME_SLOT_REF1": slots[0], "TIME_SLOT_REF2": slots[1]}
        _annotation(tier, "ALIGNABLE_ANNOTATION", {"ANNOTATION_ID": name} | where, event.comment)
    for modifier in code.modifiers:
        below = {"LINGUISTIC_TYPE_REF": MODIFIER, "PARENT_REF": code.code}
        tier = _tier(root, f"{code.code}@{modifier.name}", coder, below)
        for name, (event, _slots) in zip(names, events, strict=True):
            if value := event.modifiers.get(modifier.name):
                own = {"ANNOTATION_ID": f"a{next(numbers)}", "ANNOTATION_REF": name}
                _annotation(tier, "REF_ANNOTATION", own, value)


def _tier(root: ET.Element, name: str, coder: str, more: dict[str, str]) -> ET.Element:
    return ET.SubElement(root, "TIER", {"ANNOTATOR": coder, "TIER_ID": name} | more)


def _annotation(tier: ET.Element, kind: str, attributes: dict[str, str], text: str) -> None:
    inner = ET.SubElement(ET.SubElement(tier, "ANNOTATION"), kind, attributes)
    # XML 1.0 has no control characters; a checked coding has none either
    printable = "".join(sign for sign in text if sign.isprintable())
    ET.SubElement(inner, "ANNOTATION_VALUE").text = printable


def from_eaf(document: bytes, codes: Sequence[Code]) -> ImportedCoding:
    """Return the events of a file, and a sentence for each tier that is not imported. The name of a
    tier is a code of the scheme, or a code's name. An unreadable file is a BadCodingError.
    """
    try:
        root = safe_xml.read(document)
    except BadDefinitionError as error:
        raise BadCodingError(sentences(error.problems)) from error
    if root.tag != "ANNOTATION_DOCUMENT":
        raise BadCodingError([_("This is not an ELAN annotation file.")])
    reading = _Reading(root, codes)
    for tier in root.iter("TIER"):
        reading.take(tier)
    for tier in root.iter("TIER"):
        reading.take_modifier(tier)
    for media in root.iter("MEDIA_DESCRIPTOR"):
        name = media.get("MEDIA_URL", "").rpartition("/")[2]
        reading.problems.append(_("The linked media “%(name)s” is not imported.") % {"name": name})
    return list(reading.events.values()), reading.problems


class _Reading:
    """The events read so far, by their annotations' ids, and sentences on parts not imported."""

    def __init__(self, root: ET.Element, codes: Sequence[Code]) -> None:
        self.events: dict[str, CodedEvent] = {}
        self.problems: list[str] = []
        self._codes = {name: code for code in codes for name in (code.name, code.code)}
        slots = root.iter("TIME_SLOT")
        self._times = {slot.get("TIME_SLOT_ID"): slot.get("TIME_VALUE") for slot in slots}

    def take(self, tier: ET.Element) -> None:
        name = tier.get("TIER_ID", "")
        code = self._codes.get(name)
        if code is None:
            if self._modifier_of(tier) is None:
                text = _("Tier “%(name)s” is not a code of the scheme.")
                self.problems.append(text % {"name": name})
            return
        lost = 0
        for annotation in tier.findall("ANNOTATION/*"):
            event = self._event_of(annotation, code)
            if event is None:
                lost += 1
            else:
                key = annotation.get("ANNOTATION_ID") or f"{name} {len(self.events)}"
                self.events[key] = event
        if lost:
            text = _("Tier “%(name)s”: annotations left out because they have no times: %(n)d.")
            self.problems.append(text % {"name": name, "n": lost})

    def take_modifier(self, tier: ET.Element) -> None:
        """Read a tier of a modifier, after those of codes."""
        code, modifier = self._modifier_of(tier) or (None, None)
        if code is None or modifier is None:
            return
        for annotation in tier.findall("ANNOTATION/REF_ANNOTATION"):
            key, value = annotation.get("ANNOTATION_REF", ""), _value(annotation)
            event = self.events.get(key)
            if event is None or event.code != code.code or not value:
                continue
            if value in modifier.values:
                chosen = event.modifiers | {modifier.name: value}
                self.events[key] = structs.replace(event, modifiers=chosen)
            else:
                text = _("“%(value)s” is not a value of the modifier “%(name)s”.")
                self.problems.append(text % {"value": value, "name": modifier.name})

    def _modifier_of(self, tier: ET.Element) -> tuple[Code, Modifier] | None:
        """Return the modifier of a tier that is below a code's tier, and named after both."""
        parent, _at, name = tier.get("TIER_ID", "").rpartition("@")
        code = self._codes.get(parent) if parent == tier.get("PARENT_REF") else None
        modifiers = code.modifiers if code is not None else ()
        return next(((code, one) for one in modifiers if code and one.name == name), None)

    def _event_of(self, annotation: ET.Element, code: Code) -> CodedEvent | None:
        """Return the event of an annotation; None for one that has no times of its own."""
        slots = [self._times.get(annotation.get(f"TIME_SLOT_REF{n}")) or "" for n in (1, 2)]
        has_times = all(slot.isdecimal() and len(slot) < MAX_DIGITS for slot in slots)
        if annotation.tag != "ALIGNABLE_ANNOTATION" or not has_times:
            return None
        begin, end = (int(slot) / 1000 for slot in slots)
        is_point = code.kind == "point"
        return CodedEvent(code.code, begin, None if is_point else end, _value(annotation))


def _value(annotation: ET.Element) -> str:
    return clean(annotation.findtext("ANNOTATION_VALUE") or "")
