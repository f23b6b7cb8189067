"""Pages on which a participant sees and downloads their data, leaves a study, or deletes it all."""

import functools
from collections.abc import Callable
from typing import Any, Concatenate, ParamSpec

from django.contrib import messages
from django.contrib.auth import logout
from django.contrib.auth.decorators import login_required
from django.http import Http404, HttpRequest, HttpResponse, HttpResponseBase, JsonResponse
from django.shortcuts import get_list_or_404, get_object_or_404, redirect, render
from django.urls import reverse
from django.utils import timezone
from django.utils.translation import get_language, gettext as _
from django.views.decorators.cache import never_cache
from django.views.decorators.http import require_http_methods, require_POST, require_safe

from accounts import audit
from accounts.attempts import Attempts
from accounts.rate_limits import limited
from experiments.models import ConsentReceipt, Participant
from experiments.participation import progress, questions
from experiments.participation.consent import as_text, take_back_sharing
from experiments.participation.own_data.gathering import gather
from experiments.participation.views import show_code
from experiments.participation.withdrawal import deletion, receipt as receipts
from experiments.recruitment import recognition

FORBIDDEN = 403
OWN_DATA = Attempts("own-data", limit=10)
NEW_CODES = Attempts("new-codes", limit=5, seconds=300)
Given = ParamSpec("Given")
View = Callable[Concatenate[HttpRequest, Given], HttpResponseBase]


def private(view: View[Given]) -> View[Given]:
    """Require a login that is not based on a recruitment site's id alone: others know such ids."""

    @never_cache
    @login_required
    @functools.wraps(view)
    def checked(
        request: HttpRequest, *args: Given.args, **kwargs: Given.kwargs
    ) -> HttpResponseBase:
        if request.session.get(recognition.BY_ID_ALONE):
            return render(request, "experiments/not_confirmed.html", status=FORBIDDEN)
        return view(request, *args, **kwargs)

    return checked


@private
@require_safe
def data(request: HttpRequest) -> HttpResponse:
    language = get_language() or ""
    rows = [
        (one, progress.title_of(one.study, language), one.consents.order_by("agreed_at"))
        for one in progress.of_user(request.user)
    ]
    more = {"rows": rows, "is_driving": deletion.is_driving(request.user)}
    return render(request, "experiments/own_data.html", more)


@private
@require_safe
@limited(OWN_DATA, reading=True)
def data_download(request: HttpRequest) -> JsonResponse:
    audit.note("own_data_downloaded", actor=request.user, person=request.user)
    headers = {"Content-Disposition": 'attachment; filename="my-data.json"'}
    form = {"indent": 1, "ensure_ascii": False}
    return JsonResponse(gather(request.user), headers=headers, json_dumps_params=form)


@private
@require_POST
@limited(OWN_DATA)
def data_delete(request: HttpRequest) -> HttpResponseBase:
    user: Any = request.user
    own = list(progress.of_user(user))
    operators = {questions.operator_text(one, get_language() or "") for one in own} - {""}
    if user.is_guest and not request.POST.get("sure"):
        refusal = _("To confirm, tick the box. Nothing was deleted.")
    elif not user.is_guest and request.POST.get("username", "") != user.username:
        refusal = _("To confirm, type your user name exactly. Nothing was deleted.")
    elif deletion.is_driving(user):
        refusal = _(
            "Nothing was deleted, because you are driving a robot or waiting for one. Leave "
            "the robot or its queue first."
        )
    elif not deletion.delete_everything(user, timezone.now()):
        refusal = _("This account administers the site. Another administrator must delete it.")
    else:
        logout(request)
        messages.success(request, _("Your account and all your data have been deleted."))
        for text in operators:
            messages.info(request, text)
        return redirect("home")
    messages.error(request, refusal)
    return redirect("own_data")


@private
@require_POST
@limited(NEW_CODES)
def new_code(request: HttpRequest) -> HttpResponse:
    user: Any = request.user
    if not user.is_guest:
        raise Http404
    return show_code(request, user, reverse("own_data"))


def _own(request: HttpRequest, code: str) -> Participant:
    return get_object_or_404(progress.of_user(request.user), code=code)


@never_cache
@require_http_methods(["GET", "HEAD", "POST"])
@login_required
def withdraw(request: HttpRequest, code: str) -> HttpResponseBase:
    participant = _own(request, code)
    title = progress.title_of(participant.study, get_language() or "")
    if request.method != "POST":
        is_active = participant.status == Participant.Status.ACTIVE
        number, total = progress.step_count(participant) if is_active else (0, 0)
        more = {"participant": participant, "title": title, "number": number, "total": total}
        receipt = receipts.of(participant, get_language() or "", timezone.now())
        more["receipt"] = receipt
        more["cannot_return"] = receipt.keeps_hash and recognition.has_taken_part(participant)
        more["shares"] = participant.consents.filter(sharing=True).exists()
        return render(request, "experiments/withdraw.html", more)
    return receipts.leave(request, participant, timezone.now())


@never_cache
@require_POST
@login_required
def unshare(request: HttpRequest, code: str) -> HttpResponse:
    participant = _own(request, code)
    if take_back_sharing(participant):
        study = participant.study.slug
        audit.note("sharing_taken_back", actor=request.user, person=request.user, study=study)
    words = _("Public datasets that are made from now on do not have your data.")
    messages.success(request, words)
    return redirect("study_withdraw", code)


@private
@require_safe
def receipt(request: HttpRequest, code: str, step: str) -> HttpResponse:
    rows = ConsentReceipt.objects.select_related("participant__study").order_by("-version")
    found = get_list_or_404(rows, participant=_own(request, code), step=step)[0]
    headers = {"Content-Disposition": f'attachment; filename="consent-{code}.txt"'}
    text = as_text(found)
    return HttpResponse(text, content_type="text/plain; charset=utf-8", headers=headers)
