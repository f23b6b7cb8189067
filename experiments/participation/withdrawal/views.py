"""The page after a withdrawal, which is the receipt of it, and the receipt as a text to keep."""

import datetime

from django.contrib.auth import logout
from django.http import Http404, HttpRequest, HttpResponse
from django.shortcuts import render
from django.template.loader import render_to_string
from django.utils.translation import get_language
from django.views.decorators.cache import never_cache
from django.views.decorators.http import require_POST

from experiments.models import LEFT, Participant
from experiments.participation import completion
from experiments.participation.withdrawal import leaving
from experiments.participation.withdrawal import receipt as receipts


def leave(request: HttpRequest, participant: Participant, now: datetime.datetime) -> HttpResponse:
    """Take a participant out of a study, and show the receipt, which nothing shows again, with the
    code that the recruitment site asks for.
    """
    receipt = receipts.of(participant, get_language() or "", now)
    ending, code = completion.on_leaving(participant)
    address = completion.return_address(participant, ending)
    wants_code = bool(participant.completion_code or participant.recruitment_id)
    leaving.leave(participant, now)
    if getattr(request.user, "is_guest", False):
        logout(request)
    context = {
        "receipt": receipt,
        "signed": receipts.signed(receipt),
        "address": address,
        "code": code if wants_code else "",
        "is_finished": ending != LEFT,
    }
    return render(request, "experiments/withdrawn.html", context)


@never_cache
@require_POST
def receipt_text(request: HttpRequest) -> HttpResponse:
    """Answer with the receipt that the page carried, as text: no account is needed."""
    try:
        receipt = receipts.read(request.POST.get("receipt", ""))
    except receipts.ReceiptError as error:
        raise Http404 from error
    text = render_to_string("experiments/withdrawn.txt", {"receipt": receipt})
    name = f"withdrawal-{receipt.study}-{receipt.day}.txt"
    headers = {"Content-Disposition": f'attachment; filename="{name}"'}
    return HttpResponse(text, content_type="text/plain; charset=utf-8", headers=headers)
