"""Keys of programs that read how a study's participants are: made for one study, shown once, stored
as a hash. A key has 256 random bits, so it cannot be guessed from its hash.
"""

import datetime
import secrets
from hashlib import sha256
from typing import Any

from experiments.models import StudyKey

TOKEN_BYTES, MAX_LENGTH = 32, 128
USE_STEP = datetime.timedelta(minutes=1)  # the precision of `last_used_at`


def make_key(slug: str, label: str, user: Any, now: datetime.datetime) -> str:
    """Return a new key for a study.

    Raises:
        IntegrityError: the study has one of this label.
    """
    key = secrets.token_urlsafe(TOKEN_BYTES)
    StudyKey.objects.create(
        slug=slug, label=label, token_sha256=_hash(key), made_at=now, made_by=user
    )
    return key


def key_of(header: str, now: datetime.datetime) -> StudyKey | None:
    """Return the key of an Authorization header and note its use; None for anything else."""
    scheme, _, given = header.partition(" ")
    if scheme.lower() != "bearer" or len(given) > MAX_LENGTH:
        return None
    rows = StudyKey.objects.select_related("made_by")
    found = rows.filter(token_sha256=_hash(given.strip())).first()
    if found is not None and (found.last_used_at is None or now - found.last_used_at >= USE_STEP):
        StudyKey.objects.filter(pk=found.pk).update(last_used_at=now)
    return found


def _hash(key: str) -> str:
    return sha256(key.encode()).hexdigest()
