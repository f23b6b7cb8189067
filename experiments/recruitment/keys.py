"""Keys of programs that read the participants of one study: shown once, stored as a hash."""

import datetime
import secrets
from typing import Any

from accounts.tokens import hash_of
from experiments.models import StudyKey

TOKEN_BYTES, MAX_LENGTH = 32, 128
USE_STEP = datetime.timedelta(minutes=1)  # the precision of `last_used_at`


def make_key(slug: str, label: str, user: Any, now: datetime.datetime) -> str:
    """Return a new key for a study.

    Raises:
        IntegrityError: the study has one of this label.
    """
    key = secrets.token_urlsafe(TOKEN_BYTES)
    row = StudyKey(slug=slug, label=label, token_sha256=hash_of(key), made_at=now, made_by=user)
    row.save(force_insert=True)
    return key


def key_of(header: str, now: datetime.datetime) -> StudyKey | None:
    """Return the key of an Authorization header and note its use; None for anything else."""
    scheme, _, given = header.partition(" ")
    if scheme.lower() != "bearer" or len(given) > MAX_LENGTH:
        return None
    rows = StudyKey.objects.select_related("made_by")
    found = rows.filter(token_sha256=hash_of(given.strip())).first()
    if found is not None and (found.last_used_at is None or now - found.last_used_at >= USE_STEP):
        StudyKey.objects.filter(pk=found.pk).update(last_used_at=now)
    return found
