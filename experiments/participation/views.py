"""Entry pages of a study: its front page, a participant's code, and personal links."""

import datetime
import time
from typing import Any

from django import forms
from django.conf import settings
from django.http import Http404, HttpRequest, HttpResponse, HttpResponseBase
from django.shortcuts import redirect, render
from django.urls import reverse
from django.utils import timezone
from django.utils.http import urlencode
from django.utils.translation import get_language, gettext as _, gettext_lazy
from django.views.decorators.cache import never_cache
from django.views.decorators.http import require_http_methods

from accounts import passwordless
from accounts.attempts import Attempts, address_of
from accounts.models import User
from accounts.passwordless import NEW_GUESTS, WRONG_CODES, create_guest, sign_in
from accounts.rate_limits import limited, too_many
from experiments.models import Participant, ParticipantKind, PersonalLink, Study
from experiments.participation import advance, landing, links, progress
from experiments.recruitment import recognition, screening
from sessions.devices import device_of

# in the browser's session: the parameters of recruitment links, by study
CAME_WITH = "studies_came_with"
GONE, BAD, WRONG = 410, 400, 422
LINKS = Attempts("study-link", limit=30)


class EntryCodeForm(forms.Form):
    code = forms.CharField(
        label=gettext_lazy("Your code"),
        max_length=40,
        widget=forms.TextInput(
            attrs={"autocomplete": "off", "autocapitalize": "characters", "spellcheck": "false"}
        ),
    )


@never_cache
@require_http_methods(["GET", "HEAD", "POST"])
def front(request: HttpRequest, slug: str) -> HttpResponseBase:
    study, now = progress.study_for(request.user, slug), timezone.now()
    if study is None:
        raise Http404
    given = _parameters(request, slug)
    came, own = recognition.arrival_of(study, given), progress.found(study, request.user)
    known = None
    if own is not None and request.user.is_guest and recognition.is_someone_else(own, came):
        own = None  # the next person at the same device
    if own is None:
        kept = request.session.get(CAME_WITH, {})
        if given and kept.get(slug) != given:  # kept in the session until after a sign-up
            request.session[CAME_WITH] = {**kept, slug: given}
        known = recognition.known(study, came)
    elif own.recruitment_id and own.recruitment_id == came.identifier:
        recognition.note_submission(own, given)
    device = device_of({name.lower(): value for name, value in request.headers.items()}, "")
    has_device = screening.has_device(study.as_definition(), device)
    about: dict[str, Any] = {
        "known": known,
        "has_withdrawn": own is None and recognition.has_withdrawn(study, came, request.user),
        "has_device": has_device,
        "is_recruited": bool(came.identifier),
    }
    language = get_language() or ""
    page = landing.landing(study, request.user, own, language=language, now=now, **about)
    if request.method == "POST":
        if page["admission"] == "recognized" and known is not None:
            return _continue_as(request, known, given)
        return _take_part(request, study, own, page)
    context = {"study": study, "page": page, "own": own, "known": known}
    forms_of_page = {"sign_up": _sign_up(request), "code_form": EntryCodeForm()}
    return render(request, "experiments/landing.html", context | forms_of_page)


def _take_part(
    request: HttpRequest, study: Study, own: Participant | None, page: dict[str, Any]
) -> HttpResponseBase:
    now, user, admission = timezone.now(), request.user, page["admission"]
    has_no_device = admission == "device" and request.POST.get("go") == "none"
    if admission == "stranger":
        return redirect(_sign_up(request))
    if admission == "anonymous" or (has_no_device and not _has_full_account(user)):
        return _take_part_as_guest(request, study, now, screens_out=has_no_device)
    if admission == "finished" and own is not None and page["may_take_part_again"]:
        advance.begin_next_visit(own, now)
    elif admission == "welcome" or has_no_device:
        participant = _enter(request, study, user, now)
        if has_no_device:
            progress.screen_out(participant, now)
    elif own is None:
        return redirect("study", study.slug)
    return redirect("study_step", study.slug)


def _has_full_account(user: Any) -> bool:
    return bool(user.is_authenticated and not user.is_guest)


def _enter(request: HttpRequest, study: Study, user: Any, now: datetime.datetime) -> Participant:
    came_with = dict(request.session.get(CAME_WITH, {}))
    recruitment, kind = came_with.pop(study.slug, {}), progress.kind_of(user, study)
    about = {"recruitment": recruitment, "kind": kind, "language": get_language() or ""}
    participant = progress.enter(study, user, access="open", now=now, **about)
    # from now on they are only in the participant's row, which a withdrawal deletes
    if study.slug in request.session.get(CAME_WITH, {}):
        request.session[CAME_WITH] = came_with
    return participant


def _take_part_as_guest(
    request: HttpRequest, study: Study, now: datetime.datetime, *, screens_out: bool
) -> HttpResponseBase:
    """Make a guest. The code is shown only once, and only if no recruitment id replaces it."""
    if (refused := _too_many_guests(request)) is not None:
        return refused
    given = _parameters(request, study.slug)
    user = create_guest(User.Kind.PARTICIPANT)
    participant = _enter(request, study, user, now)
    if participant.user_id != user.pk:  # another browser entered with the same id just before
        user.delete()
        return _continue_as(request, participant, given)
    sign_in(request, user)
    if screens_out:
        progress.screen_out(participant, now)
    step = reverse("study_step", args=[study.slug])
    return redirect(step) if participant.recruitment_id else show_code(request, user, step)


def _continue_as(
    request: HttpRequest, participant: Participant, given: dict[str, str]
) -> HttpResponseBase:
    """Let in the guest that a recruitment id names; a full account needs its password."""
    if participant.user is None or not participant.user.is_guest:
        return redirect("study", participant.study.slug)
    sign_in(request, participant.user)
    came = recognition.arrival_of(participant.study, given)
    recognition.note_sign_in(request.session, participant, came)
    recognition.note_submission(participant, given)
    return redirect("study_step", participant.study.slug)


def _too_many_guests(request: HttpRequest) -> HttpResponse | None:
    address, at = address_of(request), time.time()
    if NEW_GUESTS.count(address, at):
        return None
    return too_many(request, NEW_GUESTS.wait(address, at))


def show_code(request: HttpRequest, user: User, go_on: str) -> HttpResponse:
    """Answer with a new code; it is in no session and no address, and a reload shows none."""
    code = passwordless.new_entry_code(user)
    return render(request, "experiments/entry_code.html", {"code": code, "go_on": go_on})


def _parameters(request: HttpRequest, slug: str) -> dict[str, str]:
    """Return the recruitment parameters of the link, now or when it was opened."""
    now = progress.kept_parameters({name: str(value) for name, value in request.GET.items()})
    kept: dict[str, str] = request.session.get(CAME_WITH, {}).get(slug, {})
    return now or kept


def _sign_up(request: HttpRequest) -> str:
    page = "account_signup" if settings.SIGNUP_OPEN else "account_login"
    return f"{reverse(page)}?{urlencode({'next': request.path})}"


@never_cache
@require_http_methods(["GET", "HEAD", "POST"])
def enter_code(request: HttpRequest) -> HttpResponseBase:
    address, at = address_of(request), time.time()
    if request.method != "POST":
        return render(request, "experiments/enter_code.html", {"form": EntryCodeForm()})
    if not WRONG_CODES.are_left(address, at):
        return too_many(request, WRONG_CODES.wait(address, at))
    form = EntryCodeForm(request.POST)
    user = passwordless.guest_of(form.cleaned_data["code"]) if form.is_valid() else None
    if user is None:
        WRONG_CODES.count(address, at)
        if form.is_valid():
            form.add_error("code", _("This code isn't known. Check each letter and digit."))
        return render(request, "experiments/enter_code.html", {"form": form}, status=WRONG)
    sign_in(request, user)
    newest = progress.of_user(user).first()
    return redirect("study_step", newest.study.slug) if newest is not None else redirect("own_data")


@never_cache
@require_http_methods(["GET", "HEAD", "POST"])
@limited(LINKS, reading=True, refusals={GONE})
def link(request: HttpRequest, token: str) -> HttpResponseBase:
    """Show a button that redeems a personal link: reading the page does not use it up."""
    now = timezone.now()
    try:
        found = links.find(token, request.user, now)
        if request.method == "POST":
            return _follow(request, token, found, now)
    except links.LinkError as error:
        more = {"reason": error.reason}
        return render(request, "experiments/link_refused.html", more, status=GONE)
    page = landing.landing(found.study, request.user, None, language=get_language() or "", now=now)
    context = {
        "page": page,
        "sign_up": _sign_up(request),
        "is_used": found.redeemed_at is not None,
        "needs_account": found.kind == ParticipantKind.BOT,
    }
    return render(request, "experiments/link.html", context)


def _follow(
    request: HttpRequest, token: str, found: PersonalLink, now: datetime.datetime
) -> HttpResponseBase:
    """Let in the user of a link: the guest who used it before, a full account, or a new guest. Bots
    make full accounts, whose names distinguish them. Raises a LinkError when another user has used
    it in the meantime.
    """
    guest, language = found.guest, get_language() or ""
    if guest is not None:
        sign_in(request, guest)
    elif _has_full_account(request.user):
        links.redeem(token, request.user, language=language, now=now)
    elif found.kind == ParticipantKind.BOT:
        return redirect(_sign_up(request))
    elif (refused := _too_many_guests(request)) is not None:
        return refused
    else:
        guest = create_guest(User.Kind.PARTICIPANT)
        try:
            links.redeem(token, guest, language=language, now=now)
        except links.LinkError:
            guest.delete()
            raise
        sign_in(request, guest)
    return redirect("study_step", found.study.slug)
