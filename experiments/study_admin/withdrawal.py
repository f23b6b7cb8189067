"""Researchers take a participant out of a study on request: the participant names their code, and
gets the same receipt as on the page “Your data”.
"""

from typing import Any

from django.http import Http404, HttpRequest, HttpResponse
from django.shortcuts import render
from django.utils import timezone
from django.utils.translation import get_language
from django.utils.translation import gettext as _

from accounts import audit
from experiments.access import may
from experiments.models import Participant
from experiments.participation.withdrawal import deletion
from experiments.participation.withdrawal import receipt as receipts


def may_withdraw(user: Any, participant: Participant) -> bool:
    """Tell whether a user may withdraw a participant who has not withdrawn yet."""
    is_there = participant.status != Participant.Status.WITHDRAWN
    return is_there and may(user, participant.study.slug, "researcher")


def withdraw_page(request: HttpRequest, pk: Any, frame: dict[str, Any]) -> HttpResponse:
    """Ask for the participant's code, and delete everything once it is repeated.

    Args:
        request: of a member of the staff.
        pk: of the participant.
        frame: what the pages of the administration share.
    """
    row = Participant.objects.select_related("study", "user").filter(pk=pk).first()
    if row is None or not may_withdraw(request.user, row):
        raise Http404
    more = {"title": _("Withdraw a participant"), "participant": row, "study": row.study}
    code = request.POST.get("code", "").strip().upper()
    if request.method == "POST" and code == row.code:
        now = timezone.now()
        receipt = receipts.of(row, get_language() or "", now)
        day = now.replace(hour=0, minute=0, second=0, microsecond=0)  # as all that is kept of it
        audit.note("participant_withdrawn", actor=request.user, study=row.study.slug, at=day)
        deletion.leave(row, now)
        more |= {"receipt": receipt, "signed": receipts.signed(receipt)}
    elif request.method == "POST":
        more["error"] = _("This is not the participant's code.")
    template = "admin/experiments/participant/withdraw.html"
    return render(request, template, frame | more, status=422 if "error" in more else 200)
