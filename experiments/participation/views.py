"""Entry pages of a study: its front page, a participant's code, and personal links."""

import datetime
import time
from typing import Any

from django.conf import settings
from django.http import Http404, HttpRequest, HttpResponse, HttpResponseBase
from django.shortcuts import redirect, render
from django.urls import reverse
from django.utils import timezone
from django.utils.http import urlencode
from django.utils.translation import get_language
from django.utils.translation import gettext as _
from django.views.decorators.cache import never_cache
from django.views.decorators.http import require_http_methods

from accounts.attempts import Attempts, address_of
from accounts.models import User
from accounts.passwordless import (
    NEW_GUESTS,
    WRONG_CODES,
    create_guest,
    guest_of,
    new_entry_code,
    sign_in,
)
from accounts.rate_limits import limited, too_many
from experiments.models import Participant, ParticipantKind, PersonalLink, Study
from experiments.participation import advance, landing, links, progress
from experiments.participation.forms import EntryCodeForm
from experiments.recruitment import recognition, screening
from sessions.devices import device_of

# in the browser's session: the parameters of recruitment links, by study
CAME_WITH = "studies_came_with"
GONE, BAD, WRONG = 410, 400, 422
LINKS = Attempts("study-link", limit=30)


def study_or_404(request: HttpRequest, slug: str) -> Study:
    """Return the version of a study that whoever asks gets to see.

    Raises:
        Http404: there is none for them, as if there were none at all.
    """
    study = progress.study_for(request.user, slug)
    if study is None:
        raise Http404
    return study


# --- the front page -------------------------------------------------------------------------------


@never_cache
@require_http_methods(["GET", "HEAD", "POST"])
def front(request: HttpRequest, slug: str) -> HttpResponseBase:
    """Show what a study is and how to take part; a POST takes part, the first time or again."""
    study, now = study_or_404(request, slug), timezone.now()
    given = _parameters(request, slug)
    came, own = recognition.arrival_of(study, given), progress.found(study, request.user)
    known = None
    if own is not None and request.user.is_guest and recognition.is_someone_else(own, came):
        own = None  # the next person at the same device
    if own is None:
        _keep(request, slug, given)
        known = recognition.known(study, came)
    elif own.recruitment_id and own.recruitment_id == came.identifier:
        recognition.note_submission(own, given)
    page = landing.landing(
        study,
        request.user,
        own,
        known=known,
        has_device=screening.has_device(study.as_definition(), _device(request)),
        is_recruited=bool(came.identifier),
        language=get_language() or "",
        now=now,
    )
    if request.method != "POST":
        more = {
            "study": study,
            "page": page,
            "own": own,
            "known": known,
            "sign_up": _sign_up(request),
            "code_form": EntryCodeForm(),
        }
        return render(request, "experiments/landing.html", more)
    if page.stand == "recognized" and known is not None:
        return _continue_as(request, known, given)
    return _come_in(request, study, own, page)


def _come_in(
    request: HttpRequest, study: Study, own: Participant | None, page: landing.Landing
) -> HttpResponseBase:
    now, stand = timezone.now(), page.stand
    has_none = stand == "device" and request.POST.get("go") == "none"
    if stand == "stranger":
        return redirect(_sign_up(request))
    if stand == "anonymous" or (has_none and not _is_full_account(request.user)):
        return _come_in_anonymously(request, study, now, screens_out=has_none)
    if stand == "finished" and own is not None and page.may_come_again:
        advance.come_again(own, now)
    elif stand == "welcome" or has_none:
        participant = _enter(request, study, request.user, now)
        if has_none:
            progress.screen_out(participant, now)
    elif own is None:
        return redirect("study", study.slug)
    return redirect("study_step", study.slug)


def _is_full_account(user: Any) -> bool:
    return bool(user.is_authenticated and not user.is_guest)


def _enter(request: HttpRequest, study: Study, user: Any, now: datetime.datetime) -> Participant:
    came_with = dict(request.session.get(CAME_WITH, {}))
    participant = progress.enter(
        study,
        user,
        access="open",
        recruitment=came_with.pop(study.slug, {}),
        kind=progress.kind_of(user, study),
        language=get_language() or "",
        now=now,
    )
    # from now on they are in the participant's row alone, which a withdrawal deletes
    if study.slug in request.session.get(CAME_WITH, {}):
        request.session[CAME_WITH] = came_with
    return participant


def _come_in_anonymously(
    request: HttpRequest, study: Study, now: datetime.datetime, *, screens_out: bool = False
) -> HttpResponseBase:
    """Make an account without a password. Its code is shown this once, unless the recruitment
    site's link lets the participant in again.
    """
    if (refused := _too_many_guests(request)) is not None:
        return refused
    given = _parameters(request, study.slug)
    user = create_guest(User.Kind.PARTICIPANT)
    participant = _enter(request, study, user, now)
    if participant.user_id != user.pk:  # the same id came in by another browser meanwhile
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
    """Let in a participant whom the id of a recruitment site names; an account is entered with its
    password only.
    """
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
    code = new_entry_code(user)
    return render(request, "experiments/entry_code.html", {"code": code, "go_on": go_on})


def _parameters(request: HttpRequest, slug: str) -> dict[str, str]:
    """Return what the recruiting site has written into the link, now or when it was opened."""
    now = progress.kept_parameters({name: str(value) for name, value in request.GET.items()})
    kept: dict[str, str] = request.session.get(CAME_WITH, {}).get(slug, {})
    return now or kept


def _keep(request: HttpRequest, slug: str, given: dict[str, str]) -> None:
    """Keep the parameters in the browser's session, through sign-up and all."""
    kept = request.session.get(CAME_WITH, {})
    if given and kept.get(slug) != given:
        request.session[CAME_WITH] = {**kept, slug: given}


def _device(request: HttpRequest) -> dict[str, Any]:
    headers = {name.lower(): value for name, value in request.headers.items()}
    return device_of(headers, "")


def _sign_up(request: HttpRequest) -> str:
    page = "account_signup" if settings.SIGNUP_OPEN else "account_login"
    return f"{reverse(page)}?{urlencode({'next': request.path})}"


# --- coming back with a code ----------------------------------------------------------------------


@never_cache
@require_http_methods(["GET", "HEAD", "POST"])
def enter_code(request: HttpRequest) -> HttpResponseBase:
    """Ask for the code of somebody without an account; the right one leads to where they were."""
    address, at = address_of(request), time.time()
    if request.method != "POST":
        return render(request, "experiments/enter_code.html", {"form": EntryCodeForm()})
    if not WRONG_CODES.are_left(address, at):
        return too_many(request, WRONG_CODES.wait(address, at))
    form = EntryCodeForm(request.POST)
    user = guest_of(form.cleaned_data["code"]) if form.is_valid() else None
    if user is None:
        WRONG_CODES.count(address, at)
        if form.is_valid():
            form.add_error("code", _("This code isn't known. Check each letter and digit."))
        return render(request, "experiments/enter_code.html", {"form": form}, status=WRONG)
    sign_in(request, user)
    newest = progress.of_user(user).first()
    return redirect("study_step", newest.study.slug) if newest is not None else redirect("own_data")


# --- personal links -------------------------------------------------------------------------------


@never_cache
@require_http_methods(["GET", "HEAD", "POST"])
@limited(LINKS, reading=True, refusals={GONE})
def link(request: HttpRequest, token: str) -> HttpResponseBase:
    """Show a button, or redeem the link when it is pressed: reading the page uses nothing up."""
    now = timezone.now()
    try:
        found = links.find(token, request.user, now)
        if request.method == "POST":
            return _follow(request, token, found, now)
    except links.LinkError as error:
        return render(
            request, "experiments/link_refused.html", {"reason": error.reason}, status=GONE
        )
    page = landing.landing(found.study, request.user, None, language=get_language() or "", now=now)
    more = {
        "page": page,
        "sign_up": _sign_up(request),
        "is_used": found.redeemed_at is not None,
        "needs_account": found.kind == ParticipantKind.BOT,
    }
    return render(request, "experiments/link.html", more)


def _follow(
    request: HttpRequest, token: str, found: PersonalLink, now: datetime.datetime
) -> HttpResponseBase:
    """Let in whoever pressed the button of a link: again, with their account, or with a new one
    that has no password. Bots make full accounts, whose names tell them apart.

    Raises:
        links.LinkError: somebody else used it meanwhile.
    """
    user: Any = request.user
    language = get_language() or ""
    guest = found.guest
    if guest is not None:
        sign_in(request, guest)
    elif user.is_authenticated and not user.is_guest:
        links.redeem(token, user, language=language, now=now)
    elif found.kind == ParticipantKind.BOT:
        return redirect(_sign_up(request))
    else:
        if (refused := _too_many_guests(request)) is not None:
            return refused
        guest = create_guest(User.Kind.PARTICIPANT)
        try:
            links.redeem(token, guest, language=language, now=now)
        except links.LinkError:
            guest.delete()
            raise
        sign_in(request, guest)
    return redirect("study_step", found.study.slug)
