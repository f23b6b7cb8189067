"""Invitations of colleagues to a study: sent by e-mail, accepted by the person who opens the link
and signs in or signs up. The link works once, and for two weeks.
"""

import datetime
import secrets
from typing import Any

from django.conf import settings
from django.core.mail import EmailMessage
from django.http import Http404, HttpRequest, HttpResponse
from django.shortcuts import redirect, render
from django.urls import reverse
from django.utils import timezone
from django.utils.http import urlencode
from django.utils.translation import gettext as _
from django.views.decorators.cache import never_cache
from django.views.decorators.http import require_http_methods

from accounts import audit
from accounts.adapter import INVITED
from accounts.attempts import Attempts
from accounts.rate_limits import limited
from accounts.tokens import hash_of
from experiments.models import ResearcherInvitation, Study, StudyMember
from experiments.research.study_access import shown_time

TOKEN_BYTES = 24
GONE = 410
LASTS = datetime.timedelta(days=14)
LINKS = Attempts("study-invitation", limit=30)
# These see pages of the administration; hidden operators and coders have pages of their own.
STAFF_ROLES = frozenset({"owner", "researcher", "viewer"})


def invite(request: HttpRequest, row: Study, email: str, role: str) -> tuple[str, bool]:
    """Store an invitation and send it; return its link, and whether the mail was sent. It replaces
    an earlier invitation of the same address.
    """
    token, now = secrets.token_urlsafe(TOKEN_BYTES), timezone.now()
    about, rows = {"slug": row.slug, "email": email}, ResearcherInvitation.objects
    rows.filter(**about, accepted_at=None).delete()
    about |= {"role": role, "token_sha256": hash_of(token), "invited_by": request.user}
    invitation = rows.create(**about, created_at=now, expires_at=now + LASTS)
    address = request.build_absolute_uri(reverse("study_invitation", args=[token]))
    audit.note("member_invited", actor=request.user, study=row.slug, detail=role, thing=invitation)
    return address, _send(row, invitation, address)


def _send(row: Study, invitation: ResearcherInvitation, address: str) -> bool:
    named = {
        "study": row.shown_title,
        "person": invitation.invited_by.shown_name,
        "role": invitation.get_role_display(),
        "link": address,
        "until": shown_time(invitation.expires_at),
    }
    subject = _("%(person)s invites you to the study “%(study)s”") % named
    text = _(
        "%(person)s invites you to work on the study “%(study)s”. Your role: %(role)s.\n\n"
        "Open this link, then log in or sign up:\n%(link)s\n\nIt works once, until %(until)s."
    )
    mail = EmailMessage(subject, text % named, settings.DEFAULT_FROM_EMAIL, to=[invitation.email])
    try:
        return bool(mail.send())
    except OSError:  # SMTP's errors are these
        return False


@never_cache
@require_http_methods(["GET", "HEAD", "POST"])
@limited(LINKS, reading=True, refusals={GONE})
def invitation(request: HttpRequest, token: str) -> HttpResponse:
    now = timezone.now()
    found = ResearcherInvitation.objects.filter(token_sha256=hash_of(token)).first()
    study = Study.objects.filter(slug=found.slug).first() if found is not None else None
    if found is None or study is None:
        return _refused(request, "unknown")
    if found.accepted_at is not None or found.expires_at <= now:
        return _refused(request, "used" if found.accepted_at is not None else "expired")
    user: Any = request.user
    has_account = user.is_authenticated and not user.is_guest
    if request.method == "POST":
        if not has_account:
            raise Http404
        return _accept(request, found, study, now)
    request.session[INVITED] = True
    here = urlencode({"next": request.path})
    context = {
        "invitation": found,
        "study": study,
        "has_account": has_account,
        "sign_up": f"{reverse('account_signup')}?{here}",
        "log_in": f"{reverse('account_login')}?{here}",
    }
    return render(request, "experiments/researcher_invitation.html", context)


def _refused(request: HttpRequest, reason: str) -> HttpResponse:
    return render(request, "experiments/link_refused.html", {"reason": reason}, status=GONE)


def _accept(
    request: HttpRequest, found: ResearcherInvitation, study: Study, now: datetime.datetime
) -> HttpResponse:
    user: Any = request.user
    request.session.pop(INVITED, None)
    unused = ResearcherInvitation.objects.filter(pk=found.pk, accepted_at=None)
    if not unused.update(accepted_at=now):
        return _refused(request, "used")
    of_user, given = {"slug": found.slug, "user": user}, {"role": found.role}
    member, is_new = StudyMember.objects.get_or_create(**of_user, defaults=given)
    if not is_new and member.role != StudyMember.Role.OWNER:
        StudyMember.objects.filter(pk=member.pk).update(role=found.role)
    if found.role in STAFF_ROLES and not user.is_staff:
        user.is_staff = True
        user.save(update_fields=["is_staff"])
    sender, role = found.invited_by, found.role
    audit.note("member_added", actor=sender, person=user, study=found.slug, detail=role)
    if found.role in STAFF_ROLES:
        return redirect("admin:experiments_study_change", study.pk)
    return redirect("study_wizard" if found.role == "wizard" else "study_coding", found.slug)
