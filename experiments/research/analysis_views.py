"""The analysis pages of a study, for its researchers, a topic each: tables and figures of which
every number and part leads to its sessions.
"""

from collections.abc import Iterable
from dataclasses import replace
from typing import Any
from uuid import UUID

from django.core.paginator import Paginator
from django.http import FileResponse, Http404, HttpRequest, HttpResponse, HttpResponseBase
from django.shortcuts import redirect, render
from django.urls import NoReverseMatch, reverse
from django.utils.safestring import mark_safe
from django.utils.translation import gettext, gettext_lazy
from django.views.decorators.http import require_safe

from accounts import audit
from experiments.extraction.pseudonyms import Pseudonyms
from experiments.models import Drive, ParticipantKind
from experiments.research import analysis_cache
from experiments.research.analysis_cache import Computing, NotComputedError, Stored
from experiments.research.analysis_query import AnalysisQuery, asked_of, versions_of
from experiments.research.analysis_topics import TOPICS, AnalysisTopic, topic_of
from experiments.research.figure_links import linked
from experiments.research.study_access import study_for, viewer_page
from sessions.models import Session

OUTCOMES = dict(Session.Outcome.choices)
SESSIONS_OF = {
    "participant": gettext_lazy("participants"),
    "pilot": gettext_lazy("pilots"),
    "bot": gettext_lazy("bots"),
}
SHORT = 60  # rows of a table that a topic's page shows as a whole
ROWS_A_PAGE = 100
REFRESH_S = 2
TYPES = {
    "svg": "image/svg+xml",
    "pdf": "application/pdf",
    "csv": "text/csv; charset=utf-8",
    "tex": "application/x-tex; charset=utf-8",
    "docx": "application/vnd.openxmlformats-officedocument.wordprocessingml.document",
}


@require_safe
def of_version(request: HttpRequest, pk: UUID) -> HttpResponse:
    study = study_for(request, pk, "viewer")
    return redirect(f"{reverse('analysis', args=[study.slug])}?version={study.version}")


@viewer_page
def page(request: HttpRequest, slug: str, topic: str = TOPICS[0].key) -> HttpResponse:
    here = next((one for one in TOPICS if one.key == topic), None)
    if here is None:
        raise Http404
    asked = asked_of(request, slug)
    try:
        stored = analysis_cache.report_for(asked.study, asked.kinds, asked.report)
    except NotComputedError as error:
        again = asked.address("analysis", report="")
        context = {"asked": asked, "reason": str(error), "again": again}
        return render(request, "experiments/analysis/failed.html", context, status=503)
    asked = replace(asked, report=stored.key)
    if isinstance(stored, Computing):
        return _computing(request, asked, here, stored)
    if asked.selection not in stored.selections:
        asked = replace(asked, selection=stored.selections[0])
    summary = stored.read(asked.selection, "summary")
    parts = [*summary["figures"], *summary["tables"]]
    context = _about(asked, stored) | {
        "topic": here,
        "parts": len(here.of(parts)),
        "topics": [
            {"key": one.key, "label": one.title, "url": _page_of(asked, one)}
            for one in TOPICS
            if one is here or one is TOPICS[0] or one.of(parts)
        ],
        "selections": [
            (name, name == asked.selection, _page_of(asked, here, selection=name))
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
    context = {"asked": asked, "study": asked.study, "topic": topic, "progress": computing.progress}
    answer = render(request, "experiments/analysis/computing.html", context, status=202)
    answer["Refresh"] = f"{REFRESH_S}; url={_page_of(asked, topic)}"
    return answer


def _page_of(asked: AnalysisQuery, topic: AnalysisTopic, **changes: object) -> str:
    if topic is TOPICS[0]:
        return asked.address("analysis", **changes)
    return asked.address("analysis_topic", topic.key, **changes)


def _about(asked: AnalysisQuery, stored: Stored) -> dict[str, Any]:
    return {
        "asked": asked,
        "study": asked.study,
        "stored": stored,
        "back": asked.address("analysis"),
        "is_current": stored.key == analysis_cache.key_of(asked.study, asked.kinds),
        "again": asked.address("analysis", report=""),
        "versions": versions_of(asked.study),
        "kinds": [(kind, name, kind in asked.kinds) for kind, name in SESSIONS_OF.items()],
    }


def _table(asked: AnalysisQuery, stored: Stored, head: dict[str, Any]) -> dict[str, Any]:
    name, rows = head["name"], None
    if head["rows"] <= SHORT:
        rows = _rows(asked, stored.read(asked.selection, f"table-{name}"))
    files = _files(asked, "tables", name, ("csv", "tex", "docx"))
    whole = asked.address("analysis_table", name)
    return _headed(head) | {"shown": rows, "whole": whole, "files": files}


def _files(asked: AnalysisQuery, kind: str, name: str, endings: Iterable[str]) -> Any:
    """Yield the endings and addresses of the files of a figure or a table."""
    for ending in endings:
        yield ending.upper(), asked.address("analysis_file", kind, f"{name}.{ending}")


def _rows(asked: AnalysisQuery, rows: Iterable[Any]) -> list[list[tuple[str, str]]]:
    """Return cells as their text and the address of the sessions behind them."""
    return [[(text, _address(asked, number)) for text, number in row] for row in rows]


def _address(asked: AnalysisQuery, number: int | None) -> str:
    return "" if number is None else asked.address("analysis_sessions", number)


def _figure(asked: AnalysisQuery, stored: Stored, about: dict[str, Any]) -> dict[str, Any]:
    name, behind = about["name"], about["behind"]
    svg = linked(
        (stored.folder / asked.selection / "figures" / f"{name}.svg").read_bytes(),
        name,
        about["title"],
        lambda part: _address(asked, behind.get(part)),
        lambda number: gettext("Sessions behind part %(number)d") % {"number": number},
    )
    return _headed(about) | {
        "svg": mark_safe(svg),  # noqa: S308 -- ElementTree has escaped every text in it
        "files": _files(asked, "figures", name, ("svg", "pdf", "csv")),
    }


def _headed(part: dict[str, Any]) -> dict[str, Any]:
    """Return a part of the report with its caption, a sentence in papers, as a heading."""
    return part | {"title": part["title"].removesuffix(".")}


@viewer_page
def table(request: HttpRequest, slug: str, name: str) -> HttpResponse:
    asked, stored = _stored(request, slug)
    tables = {one["name"]: one for one in stored.read(asked.selection, "summary")["tables"]}
    if name not in tables:
        raise Http404
    pages = Paginator(stored.read(asked.selection, f"table-{name}"), ROWS_A_PAGE)
    here = pages.get_page(request.GET.get("page"))
    context = _about(asked, stored) | {
        "back": _page_of(asked, topic_of(name)),
        "table": _headed(tables[name]) | {"shown": _rows(asked, here)},
        "here": here,
        "whole": asked.address("analysis_table", name),
    }
    return render(request, "experiments/analysis/table.html", context)


def _stored(request: HttpRequest, slug: str) -> tuple[AnalysisQuery, Stored]:
    """Return the query of a page, and the report that it was made of; Http404 when that was
    deleted: its numbers lead nowhere.
    """
    asked = asked_of(request, slug)
    key = asked.report or analysis_cache.key_of(asked.study, asked.kinds)
    stored = analysis_cache.found(asked.study, key)
    if stored is None or asked.selection not in stored.selections:
        raise Http404
    return replace(asked, report=key), stored


@viewer_page
def sessions(request: HttpRequest, slug: str, number: int) -> HttpResponse:
    asked, stored = _stored(request, slug)
    sets = stored.read(asked.selection, "sets")
    known = stored.read(asked.selection, "summary")["sessions"]
    if number >= len(sets):
        raise Http404
    names = Pseudonyms(asked.study.secret)
    drives = Drive.objects.filter(participant__study=asked.study)
    keys = {names.session(key): key for key in drives.values_list("session_id", flat=True)}
    rows = [
        known[code]
        | {
            "code": code,
            "outcome": OUTCOMES.get(known[code]["outcome"], known[code]["outcome"]),
            "kind_label": ParticipantKind(known[code]["kind"]).label,
            "replays": _replays(keys[code], known[code]) if code in keys else [],
        }
        for code in sets[number]
        if code in known
    ]
    people = len({row["participant"] for row in rows})
    context = _about(asked, stored) | {"rows": rows, "people": people}
    return render(request, "experiments/analysis/sessions.html", context)


def _replays(session: UUID, about: dict[str, Any]) -> list[tuple[str, str]]:
    """Return the replay from the task's beginning, and from that of each segment; none where this
    site has no replay.
    """
    try:
        address = reverse("replay", args=[session])
    except NoReverseMatch:
        return []
    moments = {"": about["start"]} | {str(n): at for n, at in enumerate(about["segments"], start=1)}
    return [(label, f"{address}?t={max(0.0, at):.1f}") for label, at in moments.items()]


@viewer_page
def file(request: HttpRequest, slug: str, kind: str, name: str) -> HttpResponseBase:
    asked, stored = _stored(request, slug)
    path = stored.folder / asked.selection / kind / name
    content_type = TYPES.get(path.suffix[1:])
    if kind not in {"tables", "figures"} or content_type is None or not path.is_file():
        raise Http404
    version = f"version {asked.study.version}"
    audit.note("analysis_exported", actor=request.user, study=slug, thing=version, detail=name)
    options = {"as_attachment": True, "filename": f"{slug}-{name}", "content_type": content_type}
    return FileResponse(path.open("rb"), **options)
