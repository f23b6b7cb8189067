"""One id of a recruitment site is one participant of a study, on any device and in all of its
versions.

A link with the id continues that participation. Other people know the id too, such as the
researchers of earlier studies, so a browser that did not show the id of the same submission gets no
copy of the participant's data (`is_confirmed`).

Participants who withdraw after they were assigned or turned away cannot join again, which would be
a second draw or a second answer to the screening. A hash of their id, or of their account, stays
for that; of an id it stays in any case, because its owner was shown a code that is to be paid. It
is keyed with the site's secret key, so that a list of ids and a copy of the database do not tell
who withdrew.
"""

from collections.abc import Mapping
from hashlib import sha256
from typing import Any

from django.utils.crypto import salted_hmac

from experiments.models import Participant, ParticipantKind, Study, not_drawn
from experiments.recruitment.sites import Arrival, arrival

# In the browser's session: the participant whom the id alone let in.
BY_ID_ALONE = "studies_by_id_alone"
FIRST_SUBMISSION = "firstSubmission"  # beside the parameters of the link


def arrival_of(study: Study, parameters: Mapping[str, str]) -> Arrival:
    return arrival(study.as_definition().recruiting, parameters)


def fields(study: Study, parameters: Mapping[str, str], kind: str) -> dict[str, str]:
    """Return the fields of a new participant's row for their id. Pilots and bots may reuse one."""
    identifier = arrival_of(study, parameters).identifier
    known = identifier and kind == ParticipantKind.PARTICIPANT
    return {
        "recruitment_id": identifier,
        "recruited_as": recruited_as(study.slug, identifier) if known else not_drawn(),
    }


def recruited_as(slug: str, identifier: str) -> str:
    """Return the unique key of an id: a hash, because some databases ignore case."""
    return f"{slug}:{sha256(identifier.encode()).hexdigest()}"


def known(study: Study, came: Arrival) -> Participant | None:
    """Return the participant who has the id, in any version of the study; None without one."""
    if not came.identifier:
        return None
    rows = Participant.objects.select_related("study", "user")
    return rows.filter(recruited_as=recruited_as(study.slug, came.identifier)).first()


def kept_after_withdrawal(participant: Participant) -> str:
    """Return the hash that stays of a participant; empty for pilots, bots, guests without an id,
    and accounts that may join again.
    """
    account = _account(participant.user) if has_taken_part(participant) else ""
    who = participant.recruitment_id or account
    is_kept = who and participant.kind == ParticipantKind.PARTICIPANT
    return withdrawn_as(participant.study.slug, who) if is_kept else ""


def has_taken_part(participant: Participant) -> bool:
    """Tell whether a participant was assigned, finished, or was turned away."""
    return bool(participant.cell or participant.completion)


def withdrawn_as(slug: str, who: str) -> str:
    return salted_hmac("experiments.withdrawn", f"{slug}:{who}", algorithm="sha256").hexdigest()


def has_withdrawn(study: Study, came: Arrival, user: Any) -> bool:
    """Tell whether the person that a link names, or this user, has withdrawn from a version of the
    study after taking part (`has_taken_part`).
    """
    hashes = [withdrawn_as(study.slug, who) for who in (came.identifier, _account(user)) if who]
    rows = Participant.objects.filter(study__slug=study.slug, recruitment_id__in=hashes)
    withdrawn = rows.filter(status=Participant.Status.WITHDRAWN)
    return withdrawn.exclude(cell="", completion="").exists()


def _account(user: Any) -> str:
    """Return the name under which an account withdraws; empty for guests, who have none to keep."""
    is_full = user is not None and user.is_authenticated and not user.is_guest
    return f"account {user.pk}" if is_full else ""


def is_confirmed(participant: Participant, came: Arrival) -> bool:
    """Tell whether a link names the participant's first submission, or the site has none."""
    own = participant.recruitment
    first = own.get(FIRST_SUBMISSION) or arrival_of(participant.study, own).session
    return bool(first == came.session)


def note_submission(participant: Participant, parameters: Mapping[str, str]) -> None:
    """Store the parameters of a later submission by a participant, who returned the first one: the
    site wants the code for the current one.
    """
    own, came = participant.recruitment, arrival_of(participant.study, parameters)
    former = arrival_of(participant.study, own).session
    if not came.session or came.session == former:
        return
    first = own.get(FIRST_SUBMISSION, former)
    participant.recruitment = {**parameters, FIRST_SUBMISSION: first}
    participant.save(update_fields=["recruitment"])


def is_someone_else(participant: Participant, came: Arrival) -> bool:
    own = participant.recruitment_id
    return bool(came.identifier and own and own != came.identifier)


def note_sign_in(session: Any, participant: Participant, came: Arrival) -> None:
    """Remember in a browser's session whether the id alone let a participant in."""
    if is_confirmed(participant, came):
        session.pop(BY_ID_ALONE, None)
    else:
        session[BY_ID_ALONE] = True
