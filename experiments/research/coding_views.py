"""The pages on which replays are coded: a study's sessions with the agreement of coders, and the
replay of one session.

Coders see pseudonyms of sessions, and nothing of other coders until all of a session are done.
"""

import uuid
from typing import Any

import msgspec
from django.contrib import messages
from django.core.paginator import Paginator
from django.http import Http404, HttpRequest, HttpResponse, HttpResponseRedirect, JsonResponse
from django.shortcuts import render
from django.urls import reverse
from django.utils import timezone
from django.utils.translation import gettext as _, ngettext
from django.views.decorators.cache import never_cache
from django.views.decorators.csrf import ensure_csrf_cookie
from django.views.decorators.gzip import gzip_page
from django.views.decorators.http import require_GET, require_POST, require_safe
from msgspec.structs import asdict

from accounts import audit
from accounts.attempts import Attempts
from accounts.rate_limits import limited
from experiments.access import drive_to_code, for_role, may, may_code
from experiments.coding import store
from experiments.coding.boris import to_boris
from experiments.coding.eaf import to_eaf
from experiments.coding.reading import import_coding
from experiments.coding.scheme import BadCodingError, scheme_in
from experiments.coding.study_agreement import agreement_of
from experiments.definition.coding import CodingScheme
from experiments.extraction.pseudonyms import Pseudonyms
from experiments.models import Coding, CodingSchemeVersion, Drive, Participant, Study
from experiments.research import coding_tables, live
from experiments.research.replay import blinded, player_config, replay
from experiments.research.study_access import version_of

SAVES, FILES = Attempts("coding-save", limit=240), Attempts("coding-file", limit=30)
ROWS_A_PAGE = 100
MAX_FILE = 5 * 1024 * 1024
EVENT_FIELDS = ("version", "code", "begin", "end", "modifiers", "comment")


@never_cache
@require_safe
def study_page(request: HttpRequest, slug: str) -> HttpResponse:
    is_coder, is_viewer = may_code(request.user, slug), may(request.user, slug, "viewer")
    if not (is_coder or is_viewer):
        raise Http404
    study = version_of(slug, request.GET.get("version", ""))
    scheme, page, agreement = store.scheme_of(study, timezone.now()), None, None
    if scheme is not None:
        # a coder sees the agreement on sessions that they coded
        found = agreement_of(scheme, None if is_viewer else request.user)
        agreement = coding_tables.shown(found, scheme)
    if scheme is not None and is_coder:
        drives = Drive.objects.filter(participant__study=study, session__ended_at__isnull=False)
        drives = drives.exclude(participant__status=Participant.Status.WITHDRAWN)
        ordered = drives.select_related("session").order_by("granted_at", "pk")
        page = Paginator(ordered, ROWS_A_PAGE).get_page(request.GET.get("page"))
        page.object_list = _rows(list(page.object_list), study, scheme, request.user)
    context = {
        "study": study,
        "versions": Study.objects.filter(slug=slug).order_by("-version"),
        "scheme": scheme,
        "definition": store.read_scheme(scheme) if scheme else None,
        "page": page,
        "may_upload": may(request.user, slug, "researcher"),
        "agreement": agreement,
    }
    return render(request, "experiments/coding/study.html", context)


def _rows(
    drives: list[Drive], study: Study, scheme: CodingSchemeVersion, user: Any
) -> list[dict[str, Any]]:
    names, definition = Pseudonyms(study.secret), study.as_definition()
    is_blind = store.read_scheme(scheme).blind
    codings: dict[uuid.UUID, list[Coding]] = {drive.session_id: [] for drive in drives}
    for coding in Coding.objects.filter(scheme=scheme, session__in=codings):
        codings[coding.session_id].append(coding)
    return [
        {
            "session": drive.session_id,
            "name": names.session(drive.session_id),
            "condition": "" if is_blind else live.condition_title(definition, drive.condition),
            "own": next((one for one in some if one.coder_id == user.pk), None),
            "begun": len(some),
            "done": sum(one.done_at is not None for one in some),
        }
        for drive, some in zip(drives, codings.values(), strict=True)
    ]


@require_POST
@limited(FILES)
@for_role("researcher")
def upload_scheme(request: HttpRequest, slug: str) -> HttpResponse:
    study = version_of(slug, request.POST.get("version", ""))
    file = request.FILES.get("file")
    try:
        scheme = scheme_in(file.read(MAX_FILE) if file is not None else b"")
    except BadCodingError as error:
        _show_problems(request, error)
    else:
        row = store.store_scheme(study, scheme, timezone.now())
        audit.note("coding_scheme_set", actor=request.user, study=slug, detail=f"{row.version}")
        messages.success(request, _("The coding scheme is version %(n)d now.") % {"n": row.version})
    return HttpResponseRedirect(_study_address(study))


def _show_problems(request: HttpRequest, error: BadCodingError) -> None:
    for problem in error.problems[:10]:
        messages.error(request, problem)


def _study_address(study: Study) -> str:
    return f"{reverse('study_coding', args=[study.slug])}?version={study.version}"


def _session_to_code(request: HttpRequest, session: uuid.UUID) -> tuple[Drive, CodingSchemeVersion]:
    """Return the drive of a session and the scheme by which it is coded: the newest, or the one
    that `scheme` names, with which a page was opened earlier; Http404 when there is none, or it is
    not for this user.
    """
    drive = drive_to_code(request.user, session)
    study, wanted = drive.participant.study, request.GET.get("scheme", "")
    if wanted.isdecimal() and len(wanted) < Study.MAX_DIGITS:
        scheme = CodingSchemeVersion.objects.filter(study=study, version=wanted).first()
    else:
        scheme = store.scheme_of(study, timezone.now())
    if scheme is None:
        raise Http404
    return drive, scheme


@never_cache
@require_safe
@ensure_csrf_cookie
def code_page(request: HttpRequest, session: uuid.UUID) -> HttpResponse:
    drive, row = _session_to_code(request, session)
    study, scheme = drive.participant.study, store.read_scheme(row)
    condition = live.condition_title(study.as_definition(), drive.condition)
    user, visitor, thing = request.user, drive.session.visitor_id, drive.session
    audit.note("session_coded", actor=user, person=visitor, study=study.slug, thing=thing)
    context = {
        "session": drive.session,
        "drive": drive,
        "who": Pseudonyms(study.secret).session(session),
        "condition": "" if scheme.blind else condition,
        "scheme": scheme,
        "back": _study_address(study),
        "config": _config(request, drive, row, scheme),
    }
    return render(request, "experiments/coding/code.html", context)


def _config(
    request: HttpRequest, drive: Drive, row: CodingSchemeVersion, scheme: CodingScheme
) -> dict[str, Any]:
    session = drive.session_id
    coding = {
        "codes": [
            asdict(code) | {"modifiers": [asdict(one) for one in code.modifiers]}
            for code in scheme.codes
        ],
        # the name under which a browser keeps changes that were not saved yet
        "kept": f"coding:{request.user.pk}:{row.pk}:{session}",
        **_answer(store.coding_of(session, row, request.user)),
    }
    for name in ("events", "save", "done"):
        coding[name] = f"{reverse(f'coding_{name}', args=[session])}?scheme={row.version}"
    data = reverse("coding_record", args=[session])
    return player_config(drive.session, data, []) | {"coding": coding}


def _answer(coding: Coding | None) -> dict[str, Any]:
    return {
        "isDone": coding is not None and coding.done_at is not None,
        "isShown": coding is not None and store.is_revealed(coding.session_id, coding.scheme),
        "saved": [
            {name: getattr(edit, name) for name in EVENT_FIELDS} | {"event": str(edit.event)}
            for edit in (store.current(coding) if coding is not None else ())
        ],
    }


@never_cache
@require_safe
@gzip_page
def record(request: HttpRequest, session: uuid.UUID) -> HttpResponse:
    """Answer with the record of a session; a blind coder's has nothing that tells the condition."""
    drive, row = _session_to_code(request, session)
    found = replay(drive.session, drive)
    shown = blinded(found) if store.read_scheme(row).blind else found
    return HttpResponse(msgspec.json.encode(shown), content_type="application/json")


@never_cache
@require_GET
def events(request: HttpRequest, session: uuid.UUID) -> JsonResponse:
    _drive, row = _session_to_code(request, session)
    return JsonResponse(_answer(store.coding_of(session, row, request.user)))


@require_POST
@limited(SAVES, json=True)
def save(request: HttpRequest, session: uuid.UUID) -> JsonResponse:
    """Store changes of events; answer with all events, and why changes were refused."""
    drive, row = _session_to_code(request, session)
    try:
        edits = msgspec.json.decode(request.body, type=store.EventEdits).edits
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        return JsonResponse({"problem": str(error)[:200]}, status=400)
    now = timezone.now()
    try:
        saved = store.save(store.begin(drive, row, request.user, now), edits, now)
        found, status = {"conflicts": saved.conflicts, "refused": saved.refused}, 200
    except BadCodingError as error:
        found, status = {"problem": str(error)}, 409
    own = store.coding_of(session, row, request.user)
    return JsonResponse(found | _answer(own), status=status)


@require_POST
@limited(SAVES, json=True)
def done(request: HttpRequest, session: uuid.UUID) -> JsonResponse:
    drive, row = _session_to_code(request, session)
    now, found, status = timezone.now(), {}, 200
    coding = store.begin(drive, row, request.user, now)
    try:
        if request.POST.get("again"):
            store.reopen(coding)
        else:
            store.finish(coding, _duration(drive), now)
    except BadCodingError as error:
        found, status = {"problem": str(error)}, 409
    own = store.coding_of(session, row, request.user)
    return JsonResponse(found | _answer(own), status=status)


def _duration(drive: Drive) -> float:
    return float(replay(drive.session, drive)["duration"])


@never_cache
@require_safe
@limited(FILES, reading=True)
def download(request: HttpRequest, session: uuid.UUID, kind: str) -> HttpResponse:
    drive, row = _session_to_code(request, session)
    coding = store.coding_of(session, row, request.user)
    name = Pseudonyms(drive.participant.study.secret).session(session)
    try:
        found = store.checked(coding, _duration(drive)) if coding is not None else []
    except BadCodingError as error:
        _show_problems(request, error)
        return HttpResponseRedirect(reverse("code_session", args=[session]))
    about = {"person": drive.session.visitor_id, "study": drive.participant.study.slug}
    audit.note("coding_exported", actor=request.user, thing=drive.session, detail=kind, **about)
    codes, who = store.read_scheme(row).codes, f"C{coding.number}" if coding is not None else "C"
    date = timezone.now()
    if kind == "eaf":
        content_type = "application/xml"
        body = to_eaf(codes, found, who, date.isoformat(timespec="seconds"))
    else:
        content_type = "application/json"
        body = to_boris(codes, {f"{name} {who}": found}, name, f"{date:%Y-%m-%dT%H:%M:%S}")
    headers = {"Content-Disposition": f'attachment; filename="{name}-{who}.{kind}"'}
    return HttpResponse(body, content_type=content_type, headers=headers)


@require_POST
@limited(FILES)
def upload(request: HttpRequest, session: uuid.UUID) -> HttpResponse:
    """Put the events of a file into the coder's coding, in place of those that it has."""
    drive, row = _session_to_code(request, session)
    file = request.FILES.get("file")
    scheme, now = store.read_scheme(row), timezone.now()
    try:
        found, left_out = import_coding(
            file.read(MAX_FILE + 1) if file is not None else b"",
            scheme.codes,
            duration=_duration(drive),
            limit=MAX_FILE,
            observation=request.POST.get("observation", "").strip(),
        )
        count = store.replace_events(store.begin(drive, row, request.user, now), found, now)
    except BadCodingError as error:
        _show_problems(request, error)
    else:
        for problem in left_out[:20]:
            messages.warning(request, problem)
        text = ngettext("%(n)d event was imported.", "%(n)d events were imported.", count)
        messages.success(request, text % {"n": count})
    return HttpResponseRedirect(reverse("code_session", args=[session]))
