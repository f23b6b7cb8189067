"""Personal links: made once, shown once, redeemed by one person.

Only a hash of the token is stored. A link is redeemed by POST alone, because programs that preview
mail open every address in it. A person without an account gets one of their own, without a password
(accounts/passwordless.py), and comes back by the same link until it is revoked.
"""

import datetime
import hashlib
import secrets
from typing import Any, Literal

from accounts.passwordless import sign_out_everywhere
from experiments.models import Participant, ParticipantKind, PersonalLink, Study
from experiments.participation import progress

TOKEN_BYTES = 24
Reason = Literal["unknown", "used", "expired", "revoked", "draft", "closed"]


class LinkError(Exception):
    """The link leads nowhere (any more); `reason` says why in one word."""

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
    """Make a link and return it with its token, which nobody can read again. What comes by a bot's
    link never counts.
    """
    token = secrets.token_urlsafe(TOKEN_BYTES)
    fields = {
        "label": label[:120],
        "access": access,
        "kind": kind,
        "created_at": now,
        "expires_at": expires_at,
    }
    return PersonalLink.objects.create(study=study, token_sha256=_hash(token), **fields), token


def revoke(link: PersonalLink, now: datetime.datetime) -> bool:
    """Take back a link; False when it was, or when somebody used it with an account of their own.
    Somebody who has no other account is signed out everywhere.
    """
    guest = link.guest
    rows = PersonalLink.objects.filter(pk=link.pk, revoked_at=None)
    if guest is None:
        rows = rows.filter(redeemed_at=None)
    done = bool(rows.update(revoked_at=now))
    if done and guest is not None:
        sign_out_everywhere(guest)
    return done


def _hash(token: str) -> str:
    return hashlib.sha256(token.encode()).hexdigest()


def find(token: str, user: Any, now: datetime.datetime) -> PersonalLink:
    """Return the link of a token that this user can redeem or has redeemed, or that lets its guest
    in again.

    Raises:
        LinkError: there is none, somebody else used it, or it does not hold any more.
    """
    link = (
        PersonalLink.objects.filter(token_sha256=_hash(token))
        .select_related("study", "participant__user")
        .first()
    )
    if link is None:
        raise LinkError("unknown")
    if _is_own(link, user):
        return link
    if link.revoked_at is not None:
        raise LinkError("revoked")
    if link.guest is not None and (not user.is_authenticated or user.is_guest):
        return link
    if link.redeemed_at is not None:
        raise LinkError("used")
    if link.expires_at is not None and link.expires_at <= now:
        raise LinkError("expired")
    refused = _why_not(link, user)
    if refused is not None:
        raise LinkError(refused)
    return link


def _why_not(link: PersonalLink, user: Any) -> Reason | None:
    """Drafts are for bots and their researchers; whoever is not signed in yet is asked again
    afterwards.
    """
    if link.study.status == Study.Status.CLOSED:
        return "closed"
    is_draft = link.study.status == Study.Status.DRAFT and link.kind != ParticipantKind.BOT
    return "draft" if is_draft and not progress.is_member(user, link.study.slug) else None


def _is_own(link: PersonalLink, user: Any) -> bool:
    return bool(
        user.is_authenticated
        and link.participant is not None
        and link.participant.user_id == user.pk
    )


def redeem(token: str, user: Any, *, language: str, now: datetime.datetime) -> Participant:
    """Let whoever is signed in take part by a link; the same person may do it again with the same
    result.

    Raises:
        LinkError: as `find`; of two who come at once the second finds it used.
    """
    link = find(token, user, now)
    if link.participant is not None and _is_own(link, user):
        return link.participant
    study = link.study
    was_there = progress.found(study, user) is not None
    access: Any = link.access
    kind = progress.kind_of(user, study) if link.kind == ParticipantKind.PARTICIPANT else link.kind
    participant = progress.enter(
        study, user, access=access, recruitment={}, kind=kind, language=language, now=now
    )
    unused = PersonalLink.objects.filter(pk=link.pk, redeemed_at=None, revoked_at=None)
    if not unused.update(redeemed_at=now, participant=participant):
        if not was_there:
            participant.delete()
        raise LinkError("used")
    return participant
