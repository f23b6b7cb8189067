"""The page after a withdrawal, which is its receipt, and the receipt as a text file."""

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
from experiments.participation.withdrawal import deletion
from experiments.participation.withdrawal import receipt as receipts


def leave(request: HttpRequest, participant: Participant, now: datetime.datetime) -> HttpResponse:
    """Withdraw a participant; show the receipt, and the code for the recruitment site."""
    receipt = receipts.of(participant, get_language() or "", now)
    ending, code = completion.on_leaving(participant)
    address = completion.return_address(participant, ending)
    wants_code = bool(participant.completion_code or participant.recruitment_id)
    deletion.leave(participant, now)
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
    """Return the receipt that the page posted, as text: no account is needed."""
    try:
        receipt = receipts.read(request.POST.get("receipt", ""))
    except receipts.ReceiptError as error:
        raise Http404 from error
    text = render_to_string("experiments/withdrawn.txt", {"receipt": receipt})
    name = f"withdrawal-{receipt.study}-{receipt.day}.txt"
    headers = {"Content-Disposition": f'attachment; filename="{name}"'}
    return HttpResponse(text, content_type="text/plain; charset=utf-8", headers=headers)
