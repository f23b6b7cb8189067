"""The receipt of a withdrawal: what was deleted, and what had been exported before; a page, and a
text file.

It is not stored. The page contains it, signed by the site, so that it can be downloaded as text for
a day.
"""

import datetime
from functools import reduce
from operator import or_
from typing import Any

import msgspec
from django.contrib.auth import logout
from django.core import signing
from django.db.models import Q, Sum
from django.http import Http404, HttpRequest, HttpResponse
from django.shortcuts import render
from django.template.loader import render_to_string
from django.utils.functional import Promise
from django.utils.translation import get_language, gettext_lazy
from django.views.decorators.cache import never_cache
from django.views.decorators.http import require_POST

from accounts import audit
from accounts.models import AuditEntry, User
from experiments.models import CodingEdit, Participant, StudyMember, TaskEvent
from experiments.participation import completion, progress, questions
from experiments.participation.withdrawal import deletion
from experiments.participation.withdrawal.deletion import responses_of
from experiments.recruitment import recognition
from sessions.models import NetworkSample, Session, SessionEvent, Snapshot, StateChunk
from surveys.document_forms.guide import words_by_kind
from surveys.models import Answer

SALT, SECONDS = "withdrawal-receipt", 86_400
_WORDS = words_by_kind(__file__, "receipt_words.csv", gettext_lazy)
COUNTED, WHAT, BY = _WORDS["counted"], _WORDS["what"], _WORDS["by"]
NOTHING = Q(pk__in=())
STAYS = _WORDS["stays"]  # what remains of a participant, and why


class Export(msgspec.Struct, frozen=True):
    """Data that were exported so many times; `what`, and `by` (a role), are keys of `WHAT` and
    `BY`.
    """

    at: datetime.datetime
    last: datetime.datetime
    times: int
    what: str
    by: str

    @property
    def what_text(self) -> str | Promise:
        return WHAT[self.what]

    @property
    def by_text(self) -> str | Promise:
        return BY[self.by]


class WithdrawalReceipt(msgspec.Struct, frozen=True):
    """The receipt: `deleted` counts rows by the keys of `COUNTED`; `waits` tells that a drive has
    yet to end, `with_account` that the account is deleted too. `completion_code` is the one that
    they got for the recruitment site; it stays valid. `keeps_hash` tells that a keyed hash stays of
    their id or account.
    """

    title: str
    study: str
    version: int
    code: str
    day: datetime.date
    with_account: bool
    waits: bool
    deleted: dict[str, int]
    exports: tuple[Export, ...]
    completion_code: str = ""
    keeps_hash: bool = False

    @property
    def counts(self) -> list[tuple[str | Promise, int]]:
        return [(COUNTED[name], number) for name, number in self.deleted.items() if number]

    @property
    def stays(self) -> list[str | Promise]:
        other = {"hash": not self.keeps_hash, "account": self.with_account}
        return [words for name, words in STAYS.items() if not other.get(name)]


def of(participant: Participant, language: str, now: datetime.datetime) -> WithdrawalReceipt:
    """Return the receipt of a withdrawal; call it before the deletion of what it counts."""
    user, study = participant.user, participant.study
    living = participant.drives.filter(Q(settled_at=None) | Q(session__closed_at=None))
    about_study = {"study": study.slug, "version": study.version, "code": participant.code}
    return WithdrawalReceipt(
        title=progress.title_of(study, language),
        day=now.date(),
        with_account=user is not None and user.is_guest and progress.of_user(user).count() == 1,
        waits=living.exists(),
        deleted=_counted(participant),
        exports=_exports(participant),
        completion_code=completion.on_leaving(participant)[1],
        keeps_hash=bool(recognition.kept_after_withdrawal(participant)),
        **about_study,
    )


def signed(receipt: WithdrawalReceipt) -> str:
    return signing.dumps(msgspec.to_builtins(receipt), salt=SALT, compress=True)


def _counted(participant: Participant) -> dict[str, int]:
    responses = responses_of(participant)
    sessions = Session.objects.filter(drive__participant=participant)
    inside = {"session__in": sessions}
    tasks = TaskEvent.objects.filter(drive__participant=participant)
    return {
        "questionnaires": responses.count(),
        "answers": Answer.objects.filter(response__in=responses).count(),
        "drives": participant.drives.count(),
        "states": StateChunk.objects.filter(**inside).aggregate(n=Sum("count"))["n"] or 0,
        "events": SessionEvent.objects.filter(**inside).count() + tasks.count(),
        "network": NetworkSample.objects.filter(**inside).count(),
        "photos": Snapshot.objects.filter(**inside).count(),
        "notes": CodingEdit.objects.filter(coding__session__in=sessions).count(),
        "consents": participant.consents.count(),
        "pages": participant.step_visits.count(),
    }


def _exports(participant: Participant) -> tuple[Export, ...]:
    study = participant.study
    sessions = [str(key) for key in participant.drives.values_list("session", flat=True)]
    of_study = Q(study=study.slug)
    scopes = {
        "study": of_study,
        "version": of_study & Q(thing=f"version {study.version}"),
        "session": Q(thing__in=sessions),
        "driver": Q() if sessions else NOTHING,
        "respondent": Q() if responses_of(participant).exists() else NOTHING,
    }
    about = reduce(or_, (Q(act=act) & scopes[scope] for act, scope in audit.COPIES.items()))
    rows = AuditEntry.objects.filter(about, at__gte=participant.created_at).order_by("at")
    members = StudyMember.objects.filter(slug=study.slug)
    roles: dict[Any, str] = dict(members.values_list("user_id", "role"))
    times: dict[tuple[str, str], list[datetime.datetime]] = {}
    for row in rows:
        times.setdefault((_what(row), _by(row.actor, roles)), []).append(row.at)
    return tuple(Export(at[0], at[-1], len(at), *key) for key, at in times.items())


def _what(entry: AuditEntry) -> str:
    if entry.act != "study_exported":
        return entry.act
    forms = [one for one in ("identified", "free_text", "public") if one in entry.detail.split()]
    return forms[0] if forms else "pseudonymous"


def _by(actor: Any, roles: dict[Any, str]) -> str:
    if actor is None:
        return "operator"
    if actor in roles:
        return roles[actor]
    is_staff = User.objects.filter(pk=actor, is_staff=True).exists()
    return "administrator" if is_staff else "former"


def leave(request: HttpRequest, participant: Participant, now: datetime.datetime) -> HttpResponse:
    """Withdraw a participant; show the receipt, and the code for the recruitment site."""
    language = get_language() or ""
    receipt = of(participant, language, now)
    operator = questions.operator_text(participant, language)
    ending, code = completion.on_leaving(participant)
    address = completion.return_address(participant, ending)
    deletion.leave(participant, now)
    if getattr(request.user, "is_guest", False):
        logout(request)
    shown: dict[str, Any] = {"code": code, "ending": ending}
    shown |= {"address": address, "operator": operator}
    context = {"receipt": receipt, "signed": signed(receipt), **shown}
    return render(request, "experiments/withdrawn.html", context)


@never_cache
@require_POST
def receipt_text(request: HttpRequest) -> HttpResponse:
    """Return the receipt that the page posted, as text: no account is needed."""
    try:
        posted = signing.loads(request.POST.get("receipt", ""), salt=SALT, max_age=SECONDS)
        receipt = msgspec.convert(posted, WithdrawalReceipt)
    except (signing.BadSignature, msgspec.ValidationError) as error:
        raise Http404 from error
    text = render_to_string("experiments/withdrawn.txt", {"receipt": receipt})
    name = f"withdrawal-{receipt.study}-{receipt.day}.txt"
    headers = {"Content-Disposition": f'attachment; filename="{name}"'}
    return HttpResponse(text, content_type="text/plain; charset=utf-8", headers=headers)
