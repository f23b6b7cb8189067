"""Codings as ELAN annotation files (.eaf), version 3.0 of the format.

The schema is http://www.mpi.nl/tools/elan/EAFv3.0.xsd. A code is a tier, named as the code, with
the coder as its annotator. ELAN knows no points: a point is an annotation of a millisecond on a
tier of the type "point", and is read back as its beginning. The annotation's text is the comment.
"""

from collections.abc import Iterator, Sequence
from xml.etree import ElementTree as ET

from django.utils.translation import gettext as _

from experiments.coding.scheme import BadCodingError, Code, CodedEvent
from surveys.documents import BadDefinitionError
from surveys.importing import safe_xml

SCHEMA = "http://www.mpi.nl/tools/elan/EAFv3.0.xsd"
POINT_MS = 1


def to_eaf(codes: Sequence[Code], events: Sequence[CodedEvent], coder: str, date: str) -> bytes:
    """Return a coding as a file.

    Args:
        codes: those of the scheme; each has its tier, also an empty one.
        events: of one coder, in order.
        coder: the pseudonym that the file names.
        date: ISO 8601 with a time zone, as the schema demands.
    """
    root = ET.Element(
        "ANNOTATION_DOCUMENT",
        {
            "AUTHOR": coder,
            "DATE": date,
            "FORMAT": "3.0",
            "VERSION": "3.0",
            "xmlns:xsi": "http://www.w3.org/2001/XMLSchema-instance",
            "xsi:noNamespaceSchemaLocation": SCHEMA,
        },
    )
    header = ET.SubElement(root, "HEADER", {"MEDIA_FILE": "", "TIME_UNITS": "milliseconds"})
    last = ET.SubElement(header, "PROPERTY", {"NAME": "lastUsedAnnotationId"})
    last.text = str(len(events))
    slots = _time_order(root, events)
    number = 0
    for code in codes:
        tier = ET.SubElement(
            root,
            "TIER",
            {"ANNOTATOR": coder, "LINGUISTIC_TYPE_REF": code.kind, "TIER_ID": code.code},
        )
        for place, event in enumerate(events):
            if event.code == code.code:
                number += 1
                _annotation(tier, number, slots[place], event.comment)
    for kind in ("point", "interval"):
        ET.SubElement(
            root,
            "LINGUISTIC_TYPE",
            {"GRAPHIC_REFERENCES": "false", "LINGUISTIC_TYPE_ID": kind, "TIME_ALIGNABLE": "true"},
        )
    ET.indent(root)
    text: str = ET.tostring(root, "unicode")
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{text}\n'.encode()


def _time_order(root: ET.Element, events: Sequence[CodedEvent]) -> list[tuple[str, str]]:
    """Write the time slots in order; return the two of each event."""
    order = ET.SubElement(root, "TIME_ORDER")
    times = []
    for place, event in enumerate(events):
        begin = round(event.begin * 1000)
        end = begin + POINT_MS if event.end is None else max(round(event.end * 1000), begin + 1)
        times += [(begin, place, 0), (end, place, 1)]
    names: dict[tuple[int, int], str] = {}
    for number, (time, place, which) in enumerate(sorted(times), start=1):
        names[place, which] = f"ts{number}"
        ET.SubElement(order, "TIME_SLOT", {"TIME_SLOT_ID": f"ts{number}", "TIME_VALUE": str(time)})
    return [(names[place, 0], names[place, 1]) for place in range(len(events))]


def _annotation(tier: ET.Element, number: int, slots: tuple[str, str], comment: str) -> None:
    outer = ET.SubElement(tier, "ANNOTATION")
    inner = ET.SubElement(
        outer,
        "ALIGNABLE_ANNOTATION",
        {
            "ANNOTATION_ID": f"a{number}",
            "TIME_SLOT_REF1": slots[0],
            "TIME_SLOT_REF2": slots[1],
        },
    )
    ET.SubElement(inner, "ANNOTATION_VALUE").text = "".join(
        sign for sign in comment if sign.isprintable() or sign == "\n"
    )


def from_eaf(document: bytes, codes: Sequence[Code]) -> tuple[list[CodedEvent], list[str]]:
    """Return the events of a file, and a sentence for each tier that is not imported.

    A tier belongs to the code or the name of a code that it is called by.

    Raises:
        BadCodingError: the file cannot be read.
    """
    try:
        root = safe_xml.read(document)
    except BadDefinitionError as error:
        raise BadCodingError(error.problems) from error
    if root.tag != "ANNOTATION_DOCUMENT":
        raise BadCodingError([_("This is not an ELAN annotation file.")])
    times = {slot.get("TIME_SLOT_ID"): slot.get("TIME_VALUE") for slot in root.iter("TIME_SLOT")}
    known = {name: code for code in codes for name in (code.name, code.code)}
    events: list[CodedEvent] = []
    problems: list[str] = []
    for tier in root.iter("TIER"):
        name = tier.get("TIER_ID", "")
        code = known.get(name)
        if code is None:
            problems.append(_("Tier “%(name)s” is not a code of the scheme.") % {"name": name})
            continue
        found = list(_events_of(tier, code, times))
        lost = sum(1 for event in found if event is None)
        if lost:
            problems.append(
                _("Tier “%(name)s”: %(n)d annotations without times were left out.")
                % {"name": name, "n": lost}
            )
        events += [event for event in found if event is not None]
    return events, problems


def _events_of(
    tier: ET.Element, code: Code, times: dict[str | None, str | None]
) -> Iterator[CodedEvent | None]:
    """Yield the events of a tier; None for an annotation that has no times of its own."""
    for annotation in tier.findall("ANNOTATION/*"):
        slots = [times.get(annotation.get(f"TIME_SLOT_REF{n}")) for n in (1, 2)]
        if annotation.tag != "ALIGNABLE_ANNOTATION" or not all(
            slot is not None and slot.isdigit() and len(slot) < 12 for slot in slots
        ):
            yield None
            continue
        begin, end = (int(slot or 0) / 1000 for slot in slots)
        comment = (annotation.findtext("ANNOTATION_VALUE") or "").strip()
        yield CodedEvent(code.code, begin, None if code.kind == "point" else end, comment)
