"""The analysis pages of a study, for its researchers, a topic each: tables and figures of which
every number and part leads to its sessions.
"""

from collections.abc import Iterable
from typing import Any
from uuid import UUID

from django.core.paginator import Paginator
from django.http import (
    FileResponse,
    Http404,
    HttpRequest,
    HttpResponse,
    HttpResponseBase,
    HttpResponseRedirect,
)
from django.shortcuts import get_object_or_404, render
from django.urls import NoReverseMatch, reverse
from django.utils.safestring import SafeString, mark_safe
from django.utils.translation import gettext, gettext_lazy
from django.views.decorators.cache import never_cache
from django.views.decorators.http import require_safe

from experiments.access import for_role, may
from experiments.extraction.pseudonyms import Pseudonyms
from experiments.models import Drive, ParticipantKind, Study
from experiments.research import analysis_cache
from experiments.research.analysis_cache import Computing, NotComputedError, Stored
from experiments.research.analysis_query import AnalysisQuery, asked_of, versions_of
from experiments.research.analysis_topics import TOPICS, AnalysisTopic, topic_of
from experiments.research.figure_links import linked
from sessions.models import Session

OUTCOMES = dict(Session.Outcome.choices)
SESSIONS_OF = {
    ParticipantKind.PARTICIPANT: gettext_lazy("participants"),
    ParticipantKind.PILOT: gettext_lazy("pilots"),
    ParticipantKind.BOT: gettext_lazy("bots"),
}
SHORT = 60  # rows of a table that stands on the page as it is
ROWS_A_PAGE = 100
REFRESH_S = 2
TYPES = {
    "svg": "image/svg+xml",
    "pdf": "application/pdf",
    "csv": "text/csv; charset=utf-8",
    "tex": "application/x-tex; charset=utf-8",
    "docx": "application/vnd.openxmlformats-officedocument.wordprocessingml.document",
}


@never_cache
@require_safe
def of_version(request: HttpRequest, pk: UUID) -> HttpResponse:
    """Lead to the analysis of one version of a study."""
    study = get_object_or_404(Study, pk=pk)
    if not may(request.user, study.slug, "viewer"):
        raise Http404
    return HttpResponseRedirect(f"{reverse('analysis', args=[study.slug])}?version={study.version}")


@never_cache
@require_safe
@for_role("viewer")
def page(request: HttpRequest, slug: str, topic: str = TOPICS[0].key) -> HttpResponse:
    """Show the tables and figures of a topic that say something."""
    here = next((one for one in TOPICS if one.key == topic), None)
    if here is None:
        raise Http404
    asked = asked_of(request, slug)
    followed = request.GET.get("report", "")
    try:
        stored = analysis_cache.report_for(asked.study, asked.kinds, followed)
    except NotComputedError as error:
        return render(
            request,
            "experiments/analysis/failed.html",
            {"asked": asked, "reason": str(error), "again": asked.address("analysis")},
            status=503,
        )
    if isinstance(stored, Computing):
        return _computing(request, asked, here, stored)
    if asked.selection not in stored.selections:
        asked = AnalysisQuery(asked.study, asked.kinds, stored.selections[0])
    summary = stored.read(asked.selection, "summary")
    parts = [*summary["figures"], *summary["tables"]]
    context = _about(asked, stored) | {
        "topic": here,
        "parts": len(here.of(parts)),
        "topics": [
            {"key": one.key, "label": one.title, "url": _page_of(asked, one, report=stored.key)}
            for one in TOPICS
            if one is here or one is TOPICS[0] or one.of(parts)
        ],
        "selections": [
            (
                name,
                name == asked.selection,
                _page_of(asked, here, selection=name, report=stored.key),
            )
            for name in stored.selections
        ],
        "tables": [_table(asked, stored, head) for head in here.of(summary["tables"])],
        "figures": [_figure(asked, stored, about) for about in here.of(summary["figures"])],
        "sessions": len(summary["sessions"]),
    }
    return render(request, "experiments/analysis/page.html", context)


def _computing(
    request: HttpRequest, asked: AnalysisQuery, topic: AnalysisTopic, computing: Computing
) -> HttpResponse:
    """Show how far a report is; the page asks for itself again until the report is there."""
    context = {
        "asked": asked,
        "study": asked.study,
        "topic": topic,
        "progress": computing.progress,
    }
    answer = render(request, "experiments/analysis/computing.html", context, status=202)
    answer["Refresh"] = f"{REFRESH_S}; url={_page_of(asked, topic, report=computing.key)}"
    return answer


def _page_of(asked: AnalysisQuery, topic: AnalysisTopic, **more: object) -> str:
    """Return the address of a topic's page; the first is the analysis itself."""
    own = () if topic is TOPICS[0] else (topic.key,)
    return asked.address("analysis_topic" if own else "analysis", *own, **more)


def _about(asked: AnalysisQuery, stored: Stored) -> dict[str, Any]:
    study = asked.study
    return {
        "asked": asked,
        "study": study,
        "stored": stored,
        "back": asked.address("analysis", report=stored.key),
        "is_current": stored.key == analysis_cache.key_of(study, asked.kinds),
        "again": asked.address("analysis"),
        "versions": versions_of(study),
        "kinds": [
            (kind.value, SESSIONS_OF[kind], kind.value in asked.kinds) for kind in SESSIONS_OF
        ],
    }


def _table(asked: AnalysisQuery, stored: Stored, head: dict[str, Any]) -> dict[str, Any]:
    is_short = head["rows"] <= SHORT
    name = head["name"]
    rows = _rows(asked, stored, stored.read(asked.selection, f"table-{name}")) if is_short else None
    return _headed(head) | {
        "shown": rows,
        "whole": asked.address("analysis_table", name, report=stored.key),
        "files": _files(asked, stored, "tables", name, ("csv", "tex", "docx")),
    }


def _files(
    asked: AnalysisQuery, stored: Stored, kind: str, name: str, endings: Iterable[str]
) -> list[tuple[str, str]]:
    return [
        (
            ending.upper(),
            asked.address("analysis_file", kind, f"{name}.{ending}", report=stored.key),
        )
        for ending in endings
    ]


def _rows(asked: AnalysisQuery, stored: Stored, rows: list[Any]) -> list[list[tuple[str, str]]]:
    """Cells as their text and the address of the sessions behind them."""
    return [[(text, _address(asked, stored, number)) for text, number in row] for row in rows]


def _address(asked: AnalysisQuery, stored: Stored, number: int | None) -> str:
    return "" if number is None else asked.address("analysis_sessions", number, report=stored.key)


def _figure(asked: AnalysisQuery, stored: Stored, about: dict[str, Any]) -> dict[str, Any]:
    name, behind = about["name"], about["behind"]
    svg = (stored.folder / asked.selection / "figures" / f"{name}.svg").read_bytes()
    drawn = linked(
        svg,
        name,
        about["title"],
        lambda part: _address(asked, stored, behind.get(part)),
        lambda number: gettext("Sessions behind part %(number)d") % {"number": number},
    )
    return _headed(about) | {
        "svg": _safe(drawn),
        "files": _files(asked, stored, "figures", name, ("svg", "pdf", "csv")),
    }


def _headed(part: dict[str, Any]) -> dict[str, Any]:
    """Return a part of the report with its caption, a sentence in papers, as a heading."""
    return part | {"title": part["title"].removesuffix(".")}


def _safe(svg: str) -> SafeString:
    """What ElementTree wrote of our own figure has every text escaped."""
    return mark_safe(svg)  # noqa: S308 -- as said


@never_cache
@require_safe
@for_role("viewer")
def table(request: HttpRequest, slug: str, name: str) -> HttpResponse:
    """Show a long table, some rows at a time."""
    asked = asked_of(request, slug)
    stored = _stored(request, asked)
    head = next(
        (one for one in stored.read(asked.selection, "summary")["tables"] if one["name"] == name),
        None,
    )
    if head is None:
        raise Http404
    pages = Paginator(stored.read(asked.selection, f"table-{name}"), ROWS_A_PAGE)
    here = pages.get_page(request.GET.get("page"))
    steps = {
        word: asked.address("analysis_table", name, page=number, report=stored.key)
        for word, number in _neighbours(here)
    }
    context = _about(asked, stored) | {
        "back": _page_of(asked, topic_of(name), report=stored.key),
        "table": _headed(head) | {"shown": _rows(asked, stored, list(here))},
        "here": here,
        "steps": steps,
    }
    return render(request, "experiments/analysis/table.html", context)


def _neighbours(here: Any) -> Iterable[tuple[str, int]]:
    if here.has_previous():
        yield "before", here.previous_page_number()
    if here.has_next():
        yield "next", here.next_page_number()


def _stored(request: HttpRequest, asked: AnalysisQuery) -> Stored:
    """Return the report that a page was made of, as long as it is there; else there is nothing to
    be found by its numbers.
    """
    key = request.GET.get("report", "")
    stored = (
        analysis_cache.found(asked.study, key)
        if key
        else analysis_cache.found(asked.study, analysis_cache.key_of(asked.study, asked.kinds))
    )
    if stored is None or asked.selection not in stored.selections:
        raise Http404
    return stored


@never_cache
@require_safe
@for_role("viewer")
def sessions(request: HttpRequest, slug: str, number: int) -> HttpResponse:
    """Show the sessions behind a number, each with its replay."""
    asked = asked_of(request, slug)
    stored = _stored(request, asked)
    sets, known = (
        stored.read(asked.selection, "sets"),
        stored.read(asked.selection, "summary")["sessions"],
    )
    if number >= len(sets):
        raise Http404
    keys = _keys(asked.study)
    rows = [
        known[code]
        | {
            "code": code,
            "outcome": OUTCOMES.get(known[code]["outcome"], known[code]["outcome"]),
            "kind_label": ParticipantKind(known[code]["kind"]).label,
            "replays": _replays(keys.get(code), known[code]),
        }
        for code in sets[number]
        if code in known
    ]
    context = _about(asked, stored) | {
        "rows": rows,
        "people": len({row["participant"] for row in rows}),
    }
    return render(request, "experiments/analysis/sessions.html", context)


def _keys(study: Study) -> dict[str, UUID]:
    """The sessions' rows by their codes."""
    names = Pseudonyms(study.secret)
    rows = Drive.objects.filter(participant__study=study).values_list("session_id", flat=True)
    return {names.session(key): key for key in rows}


def _replays(session: UUID | None, about: dict[str, Any]) -> list[tuple[str, str]]:
    """The replay from the task's beginning, and from that of each segment; none where this site has
    no replay.
    """
    if session is None:
        return []
    try:
        address = reverse("replay", args=[session])
    except NoReverseMatch:
        return []
    moments = [
        ("", about["start"]),
        *((str(number), at) for number, at in enumerate(about["segments"], start=1)),
    ]
    return [(label, f"{address}?t={max(0.0, at):.1f}") for label, at in moments]


@never_cache
@require_safe
@for_role("viewer")
def file(request: HttpRequest, slug: str, kind: str, name: str) -> HttpResponseBase:
    """Send a table or figure as a file."""
    asked = asked_of(request, slug)
    stored = _stored(request, asked)
    path = stored.folder / asked.selection / kind / name
    if (
        path.parent.name not in {"tables", "figures"}
        or path.suffix[1:] not in TYPES
        or not path.is_file()
    ):
        raise Http404
    return FileResponse(
        path.open("rb"),
        as_attachment=True,
        filename=f"{slug}-{name}",
        content_type=TYPES[path.suffix[1:]],
    )
