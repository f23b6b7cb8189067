"""The events that coders noted on the replays, and how well they agree: tables, and files of ELAN
and BORIS.

Coders go by their numbers. A session that is still being coded is left out, so that no coder reads
the events of another before their own coding is done.
"""

from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import msgspec
import numpy as np

from experiments.coding import store
from experiments.coding.agreement import ReliabilityEstimate
from experiments.coding.boris import to_boris
from experiments.coding.eaf import to_eaf
from experiments.coding.scheme import CodedEvent
from experiments.coding.study_agreement import StudyAgreement, agreement_of
from experiments.dataset.columns import Column, Tables
from experiments.dataset.records import Dataset
from experiments.definition.coding import CodingScheme
from experiments.export.format import ExportFormat, File
from experiments.extraction.allow_list import coded
from experiments.extraction.forms import Origin, kept
from experiments.models import Coding, CodingSchemeVersion, Drive

NO_DATE = "1970-01-01T00:00:00"  # ELAN and BORIS want one, and a dataset has none
CODE_KINDS = {"point": "a moment", "interval": "a time with a beginning and an end"}
FIGURES = {
    "alpha": "Krippendorff's α by time, of all coders",
    "kappa": "Cohen's κ by time, of two coders",
    "agreement": "share of the time that two coders coded alike",
    "event_kappa": "Cohen's κ by events that two coders matched",
}
CODINGS = (
    Column("session", "", "code of the session"),
    Column("coder", "", "number of the coder"),
    Column("scheme", "", "version of the coding scheme"),
    Column("events", "", "how many events were coded"),
)
CODED = (
    *CODINGS[:3],
    Column("code", "", "code of the scheme"),
    Column("kind", "", "what the code marks", levels=CODE_KINDS),
    Column("begin", "s", "since the grant, by the server's clock"),
    Column("end", "s", "since the grant, by the server's clock; empty for a point"),
    Column("modifiers", "", "chosen values by the modifiers' names, as JSON"),
    Column("comment", "", "the coder's comment; only with free text"),
)
AGREEMENT = (
    Column("scheme", "", "version of the coding scheme"),
    Column("code", "", "code of the scheme; all: all codes together"),
    Column("figure", "", "how agreement is measured", levels=FIGURES),
    Column("coders", "", "numbers of the coders, separated by |"),
    Column("value", "", "of the figure"),
    Column("low", "", "lower end of the 95 % confidence interval"),
    Column("high", "", "upper end of the 95 % confidence interval"),
)
CONFUSION = (
    Column("scheme", "", "version of the coding scheme"),
    Column("first", "", "number of the first coder"),
    Column("second", "", "number of the second coder"),
    Column("first_code", "", "what the first coded; empty: nothing"),
    Column("second_code", "", "what the second coded at that time; empty: nothing"),
    Column("events", "", "how many such events"),
)


class CodingsFormat(ExportFormat):
    """Part of every export of a study with finished codings."""

    tables = {"codings": CODINGS, "coded": CODED, "agreement": AGREEMENT, "confusion": CONFUSION}

    @classmethod
    def tables_of(cls, _dataset: Dataset, drives: Sequence[Drive]) -> Tables:
        return cls.tables if _schemes(drives) else {}

    def of_study(self) -> Iterator[File]:
        drives = {drive.session_id for drive in self.source.drives}
        schemes = _schemes(self.source.drives)
        if not schemes:
            return
        found = {row: [one for one in some if one.session_id in drives] for row, some in schemes}
        every = [(row, coding) for row, some in found.items() for coding in some]
        agreements = [(row.version, agreement_of(row)) for row in found]
        table = self.source.table
        yield table("codings", (self._row(*one) for one in every))
        yield table("coded", (cells for one in every for cells in self._events(*one)))
        yield table("agreement", (cells for one in agreements for cells in _figures(*one)))
        yield table("confusion", (cells for one in agreements for cells in _confusions(*one)))
        for row, codings in found.items():
            yield from self._files(row, codings)

    def _name(self, coding: Coding) -> str:
        return self.source.release.names.session(coding.session_id)

    def _row(self, row: CodingSchemeVersion, coding: Coding) -> tuple[Any, ...]:
        return self._name(coding), f"C{coding.number}", row.version, len(store.current(coding))

    def _released(self, scheme: CodingScheme, coding: Coding) -> list[CodedEvent]:
        """Return the events of a coding with the parts that an export may contain."""
        listed, origin = coded(scheme), Origin(0.0)
        events = map(msgspec.structs.asdict, store.events_of(coding))
        rows = (kept(listed, event, self.source.release, origin) for event in events)
        return [CodedEvent(**row) for row in rows if "code" in row and "begin" in row]

    def _events(self, row: CodingSchemeVersion, coding: Coding) -> Iterator[tuple[Any, ...]]:
        scheme = store.read_scheme(row)
        for event in self._released(scheme, coding):
            code = scheme.code(event.code)
            kind = code.kind if code is not None else ""
            modifiers = msgspec.json.encode(event.modifiers, order="sorted").decode()
            about = (self._name(coding), f"C{coding.number}", row.version, event.code, kind)
            yield *about, event.begin, event.end, modifiers, event.comment

    def _files(self, row: CodingSchemeVersion, codings: Iterable[Coding]) -> Iterator[File]:
        scheme, observations = store.read_scheme(row), {}
        folder = f"codings/scheme-{row.version}"
        document = msgspec.json.format(msgspec.json.encode(scheme), indent=2)
        yield f"{folder}.json", [document + b"\n"]
        for coding in codings:
            events, who = self._released(scheme, coding), f"C{coding.number}"
            observations[f"{self._name(coding)} {who}"] = events
            file = to_eaf(scheme.codes, events, who, f"{NO_DATE}+00:00")
            yield f"{folder}/session-{self._name(coding)}-{who}.eaf", [file]
        yield f"{folder}.boris", [to_boris(scheme.codes, observations, "codings", NO_DATE)]


def _schemes(drives: Iterable[Drive]) -> list[tuple[CodingSchemeVersion, list[Coding]]]:
    """Return the schemes by which sessions were coded, with their finished codings."""
    sessions = [drive.session_id for drive in drives]
    rows = CodingSchemeVersion.objects.filter(codings__session__in=sessions).distinct()
    found = ((row, store.released(row)) for row in rows.order_by("version"))
    return [(row, codings) for row, codings in found if codings]


def _figures(version: int, agreement: StudyAgreement) -> Iterator[tuple[Any, ...]]:
    def row(code: str, figure: str, places: Iterable[int], one: ReliabilityEstimate) -> Any:
        coders = "|".join(f"C{agreement.coders[place]}" for place in places)
        return version, code or "all", figure, coders, one.value, one.low, one.high

    for one in agreement.found.codes:
        yield row(one.code, "alpha", range(len(agreement.coders)), one.alpha)
        for pair in one.pairs:
            yield row(one.code, "kappa", pair.coders, pair.kappa)
            yield row(one.code, "agreement", pair.coders, pair.agreement)
    for events in agreement.found.events:
        yield row("", "event_kappa", events.coders, events.kappa)


def _confusions(version: int, agreement: StudyAgreement) -> Iterator[tuple[Any, ...]]:
    for pair in agreement.found.events:
        first, second = (f"C{agreement.coders[place]}" for place in pair.coders)
        labels = [*pair.labels, ""]
        for (row, column), count in np.ndenumerate(pair.table.astype(int)):
            if count:
                yield version, first, second, labels[row], labels[column], int(count)
