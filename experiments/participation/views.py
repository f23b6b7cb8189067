"""The doors of a study: its front page, personal links, and a participant's own data."""

from typing import Any

from django.conf import settings
from django.contrib import messages
from django.contrib.auth import logout
from django.contrib.auth.decorators import login_required
from django.contrib.auth.views import redirect_to_login
from django.http import Http404, HttpRequest, HttpResponse, HttpResponseBase, JsonResponse
from django.shortcuts import get_object_or_404, redirect, render
from django.urls import reverse
from django.utils import timezone
from django.utils.http import urlencode
from django.utils.translation import get_language
from django.utils.translation import gettext as _
from django.views.decorators.cache import never_cache
from django.views.decorators.http import require_http_methods, require_POST, require_safe

from accounts import audit
from accounts.attempts import Attempts
from accounts.rate_limits import limited
from experiments.models import ConsentReceipt, Participant, Study
from experiments.participation import consent, landing, links, own_data, progress

# in the browser's session: the parameters of recruitment links, by study
CAME_WITH = "studies_came_with"
GONE, FORBIDDEN, BAD = 410, 403, 400
LINKS, OWN_DATA = Attempts("study-link", limit=30), Attempts("own-data", limit=10)


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
    _keep_parameters(request, slug)
    own = progress.found(study, request.user)
    page = landing.landing(study, request.user, own, language=get_language() or "", now=now)
    if request.method != "POST":
        return render(
            request,
            "experiments/landing.html",
            {"study": study, "page": page, "own": own, "sign_up": _sign_up(request)},
        )
    return _come_in(request, study, own, page.stand)


def _come_in(
    request: HttpRequest, study: Study, own: Participant | None, stand: landing.Stand
) -> HttpResponseBase:
    now = timezone.now()
    if stand == "stranger":
        return redirect(_sign_up(request))
    if stand == "finished" and own is not None:
        progress.come_again(own, now)
    elif stand == "welcome":
        kind = progress.kind_of(request.user, study)
        came_with = request.session.get(CAME_WITH, {}).get(study.slug, {})
        progress.enter(
            study,
            request.user,
            access="open",
            recruitment=came_with,
            kind=kind,
            language=get_language() or "",
            now=now,
        )
    elif own is None:
        return redirect("study", study.slug)
    return redirect("study_step", study.slug)


def _keep_parameters(request: HttpRequest, slug: str) -> None:
    """Keep what the recruiting site has written into the link, through sign-up and all."""
    found = progress.kept_parameters({name: str(value) for name, value in request.GET.items()})
    if found:
        request.session[CAME_WITH] = {**request.session.get(CAME_WITH, {}), slug: found}


def _sign_up(request: HttpRequest) -> str:
    page = "account_signup" if settings.SIGNUP_OPEN else "account_login"
    return f"{reverse(page)}?{urlencode({'next': request.path})}"


# --- personal links -------------------------------------------------------------------------------


@never_cache
@require_http_methods(["GET", "HEAD", "POST"])
@limited(LINKS, reading=True, refusals={GONE})
def link(request: HttpRequest, token: str) -> HttpResponseBase:
    """Show a button, or redeem the link when it is pressed: reading the page uses nothing up."""
    now = timezone.now()
    try:
        found = links.find(token, request.user, now)
        if request.method == "POST" and request.user.is_authenticated:
            participant = links.redeem(token, request.user, language=get_language() or "", now=now)
            return redirect("study_step", participant.study.slug)
    except links.LinkError as error:
        return render(
            request, "experiments/link_refused.html", {"reason": error.reason}, status=GONE
        )
    if request.method == "POST":
        return redirect(_sign_up(request))
    page = landing.landing(found.study, request.user, None, language=get_language() or "", now=now)
    return render(request, "experiments/link.html", {"page": page, "sign_up": _sign_up(request)})


# --- one's own data -------------------------------------------------------------------------------


@never_cache
@login_required
@require_safe
def data(request: HttpRequest) -> HttpResponse:
    """Show in what somebody takes part, and what they may do with what is kept of them."""
    language = get_language() or ""
    rows = [
        (one, progress.title_of(one.study, language), one.consents.order_by("agreed_at"))
        for one in progress.of_user(request.user)
    ]
    return render(
        request,
        "experiments/own_data.html",
        {"rows": rows, "is_driving": own_data.is_driving(request.user)},
    )


@never_cache
@login_required
@require_safe
@limited(OWN_DATA, reading=True)
def data_download(request: HttpRequest) -> JsonResponse:
    """Answer with everything that is kept of whoever asks."""
    audit.note("own_data_downloaded", actor=request.user, person=request.user)
    headers = {"Content-Disposition": 'attachment; filename="my-data.json"'}
    return JsonResponse(
        own_data.gather(request.user),
        headers=headers,
        json_dumps_params={"indent": 1, "ensure_ascii": False},
    )


@never_cache
@login_required
@require_POST
@limited(OWN_DATA)
def data_delete(request: HttpRequest) -> HttpResponseBase:
    """Delete the account and all that belongs to it, when the user's name was typed as a
    confirmation.
    """
    user: Any = request.user
    if request.POST.get("username", "") != user.username:
        messages.error(
            request,
            _("Type your user name exactly, to show that you mean it. Nothing was deleted."),
        )
    elif own_data.is_driving(user):
        messages.error(
            request,
            _("You are on a robot, or in line for one: leave it first. Nothing was deleted."),
        )
    elif not own_data.delete_everything(user, timezone.now()):
        messages.error(
            request, _("This account runs the site: another administrator has to delete it.")
        )
    else:
        logout(request)
        messages.success(request, _("Your account and all your data are deleted."))
        return redirect("home")
    return redirect("own_data")


def _own(request: HttpRequest, code: str) -> Participant:
    """Return somebody's own participation; another's is not found."""
    return get_object_or_404(progress.of_user(request.user), code=code)


@never_cache
@require_http_methods(["GET", "HEAD", "POST"])
def withdraw(request: HttpRequest, code: str) -> HttpResponseBase:
    """Ask whether somebody means it, or take them out of the study."""
    if not request.user.is_authenticated:
        return redirect_to_login(request.get_full_path())
    participant = _own(request, code)
    title = progress.title_of(participant.study, get_language() or "")
    if request.method != "POST":
        return render(
            request, "experiments/withdraw.html", {"participant": participant, "title": title}
        )
    own_data.withdraw(participant, timezone.now())
    return render(request, "experiments/withdrawn.html", {"title": title})


@never_cache
@login_required
@require_safe
def receipt(request: HttpRequest, code: str, step: str) -> HttpResponse:
    """Answer with what somebody agreed to, as a text to keep."""
    row = ConsentReceipt.objects.filter(participant=_own(request, code), step=step).select_related(
        "participant", "participant__study"
    )
    found = row.order_by("-version").first()
    if found is None:
        raise Http404
    headers = {"Content-Disposition": f'attachment; filename="consent-{code}.txt"'}
    return HttpResponse(
        consent.as_text(found), content_type="text/plain; charset=utf-8", headers=headers
    )
