"""Personal links: made once, shown once, redeemed by one person.

Only a hash of the token is stored. A link is redeemed only by POST, because programs that preview
mail open every address in it. A person without an account gets one without a password
(accounts/passwordless.py), and returns by the same link until it is revoked.
"""

import datetime
import secrets
from typing import Any, Literal, cast

from accounts.passwordless import sign_out_everywhere
from accounts.tokens import hash_of
from experiments.models import Participant, ParticipantKind, PersonalLink, Study
from experiments.participation import progress
from experiments.participation.assignment import Access

TOKEN_BYTES = 24
Reason = Literal["unknown", "used", "expired", "revoked", "draft", "closed"]


class LinkError(Exception):
    """The link does not work, or not any more."""

    def __init__(self, reason: Reason) -> None:
        super().__init__(reason)
        self.reason: Reason = reason


def make(
    study: Study,
    *,
    label: str = "",
    access: str = "invitation",
    kind: str = ParticipantKind.PARTICIPANT,
    expires_at: datetime.datetime | None = None,
    now: datetime.datetime,
) -> tuple[PersonalLink, str]:
    """Return a link and its token, which is not stored. A bot's participants never count."""
    token = secrets.token_urlsafe(TOKEN_BYTES)
    fields = {"study": study, "label": label[:120], "access": access, "kind": kind}
    times = {"created_at": now, "expires_at": expires_at}
    link = PersonalLink.objects.create(token_sha256=hash_of(token), **times, **fields)
    return link, token


def revoke(link: PersonalLink, now: datetime.datetime) -> bool:
    """Revoke a link and sign its guest out everywhere; False when a full account has used it."""
    guest = link.guest
    rows = PersonalLink.objects.filter(pk=link.pk, revoked_at=None)
    if guest is None:
        rows = rows.filter(redeemed_at=None)
    done = bool(rows.update(revoked_at=now))
    if done and guest is not None:
        sign_out_everywhere(guest)
    return done


def find(token: str, user: Any, now: datetime.datetime) -> PersonalLink:
    """Return the link of a token that this user can redeem or has redeemed, or that lets its guest
    in again; a LinkError when it cannot be used, or not by this user.
    """
    rows = PersonalLink.objects.filter(token_sha256=hash_of(token))
    link = rows.select_related("study", "participant__user").first()
    if link is None:
        raise LinkError("unknown")
    if not _is_own(link, user) and (reason := _why_not(link, user, now)) is not None:
        raise LinkError(reason)
    return link


def _why_not(link: PersonalLink, user: Any, now: datetime.datetime) -> Reason | None:
    if link.revoked_at is not None:
        return "revoked"
    if link.guest is not None and (not user.is_authenticated or user.is_guest):
        return None
    if link.redeemed_at is not None:
        return "used"
    if link.expires_at is not None and link.expires_at <= now:
        return "expired"
    if link.study.status == Study.Status.CLOSED:
        return "closed"
    # drafts are for bots and their researchers
    is_draft = link.study.status == Study.Status.DRAFT and link.kind != ParticipantKind.BOT
    return "draft" if is_draft and not progress.is_member(user, link.study.slug) else None


def _is_own(link: PersonalLink, user: Any) -> bool:
    participant = link.participant
    return user.is_authenticated and participant is not None and participant.user_id == user.pk


def redeem(token: str, user: Any, *, language: str, now: datetime.datetime) -> Participant:
    """Let the user take part by a link; a second call has the same result. Raises a LinkError as
    `find`, also for the second of two users at the same moment.
    """
    link = find(token, user, now)
    if link.participant is not None and _is_own(link, user):
        return link.participant
    study, access = link.study, cast("Access", link.access)
    had_joined = progress.found(study, user) is not None
    kind = progress.kind_of(user, study) if link.kind == ParticipantKind.PARTICIPANT else link.kind
    participant = progress.enter(
        study, user, access=access, recruitment={}, kind=kind, language=language, now=now
    )
    unused = PersonalLink.objects.filter(pk=link.pk, redeemed_at=None, revoked_at=None)
    if not unused.update(redeemed_at=now, participant=participant):
        if not had_joined:
            participant.delete()
        raise LinkError("used")
    return participant
