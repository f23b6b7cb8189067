"""Whether the site still lacks its first account, and the code that allows to create it."""

from django.utils.crypto import salted_hmac

from accounts.models import User
from robots.models import Robot

CODE_LENGTH, GROUP = 20, 5


class _SetUp:
    """What this process knows: a site that is set up stays so."""

    is_set_up = False


def is_fresh() -> bool:
    """Tell whether the site has no account of a person and no robot yet."""
    if not _SetUp.is_set_up:
        has_robot = Robot.objects.filter(practice=False).exists()
        _SetUp.is_set_up = has_robot or User.objects.filter(kind=User.Kind.FULL).exists()
    return not _SetUp.is_set_up


def setup_code() -> str:
    """Return the code, derived from SECRET_KEY, so that all processes know the same one."""
    digest = salted_hmac("telepresence.first-run", "administrator", algorithm="sha256").hexdigest()
    return "-".join(digest[start : start + GROUP] for start in range(0, CODE_LENGTH, GROUP))
