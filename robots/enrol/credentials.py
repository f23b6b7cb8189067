"""Robots' tokens for the broker: 256 random bits, shown once, stored as hashes.

The hash has Mosquitto's form, `$7$<iterations>$<salt>$<hash>` (PBKDF2 with SHA-512, base64), so
that one string serves Mosquitto's password file and the HTTPS endpoint. NATS reads only bcrypt:
each token has a second hash for it, an older token once an agent sends it (`robot_of`).

256 random bits cannot be guessed, so the iterations protect nothing. There are as few as
`mosquitto_passwd` uses and bcrypt allows, because a broker checks them between two messages.
"""

import base64
import binascii
import datetime
import hashlib
import hmac
import secrets
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from django.utils import timezone
from django.utils.crypto import salted_hmac

from robots.api.credentials_file import toml
from robots.api.private_files import write_private
from robots.models import Robot, RobotCredentials

TOKEN_BYTES = 32
ITERATIONS = 101
SALT_BYTES = 12  # the only length that Mosquitto reads
HASH_BYTES = 64
BCRYPT_COST = 4
BCRYPT_SALT_BYTES = 16
# base64's alphabet and bcrypt's, in the order of their values
TO_BCRYPT = bytes.maketrans(
    b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/",
    b"./ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789",
)
GRACE = datetime.timedelta(hours=24)
NONE: dict[str, Any] = {
    "credential_user": "",
    "credential_hash": "",
    "bcrypt_hash": "",
    "former_user": "",
    "former_hash": "",
    "former_bcrypt_hash": "",
    "former_until": None,
    "renewal_asked_at": None,
}
MAX_ITERATIONS = 100_000

# A robot's name has no dot, so that no robot can have a server's name.
ServerPart = Literal["web", "session-manager"]
SERVER_USERS: dict[ServerPart, str] = {
    "web": "server.web",
    "session-manager": "server.session-manager",
}


@dataclass(frozen=True)
class Credentials:
    """What a robot's computer needs besides the server's address."""

    robot: str
    token: str = field(repr=False)
    user: str = ""  # at the broker, when that is not the robot's name

    def toml(self, **addresses: str) -> str:
        """Return the content of a credentials file; `addresses` are further lines, such as `server`
        or `mqtt_url`.
        """
        user = {"user": self.user} if self.user else {}
        return toml({"robot": self.robot, **user, "token": self.token, **addresses})


def new_token() -> str:
    """Return 256 random bits as text for shells, URLs and MQTT, unlike an option of a command."""
    while (token := secrets.token_urlsafe(TOKEN_BYTES)).startswith("-"):
        pass
    return token


def hash_token(token: str, *, salt: bytes | None = None, iterations: int = ITERATIONS) -> str:
    """Return the hash of a token in Mosquitto's `$7$` form."""
    salt = secrets.token_bytes(SALT_BYTES) if salt is None else salt
    digest = hashlib.pbkdf2_hmac("sha512", token.encode(), salt, iterations, HASH_BYTES)
    return f"$7${iterations}${base64.b64encode(salt).decode()}${base64.b64encode(digest).decode()}"


def bcrypt_hash(token: str, *, salt: bytes | None = None) -> str:
    """Return the hash of a token in bcrypt's `$2b$` form, of the first 16 bytes of `salt`."""
    import bcrypt  # noqa: PLC0415 -- robots' computers do without it

    salt = secrets.token_bytes(BCRYPT_SALT_BYTES) if salt is None else salt[:BCRYPT_SALT_BYTES]
    letters = base64.b64encode(salt).rstrip(b"=").translate(TO_BCRYPT)
    return bcrypt.hashpw(token.encode(), b"$2b$%02d$%s" % (BCRYPT_COST, letters)).decode()


def matches(token: str, credential_hash: str) -> bool:
    """Tell whether a token has this hash; an empty or malformed hash matches nothing."""
    try:
        empty, kind, iterations, *parts = credential_hash.split("$")
        salt, expected = (base64.b64decode(part, validate=True) for part in parts)
        count = int(iterations)
        if empty or kind != "7" or not 0 < count <= MAX_ITERATIONS:
            return False
        found = hashlib.pbkdf2_hmac("sha512", token.encode(), salt, count, HASH_BYTES)
    except (ValueError, binascii.Error):
        return False
    return hmac.compare_digest(found, expected)


def make_credentials(robot: Robot, now: datetime.datetime) -> Credentials:
    """Give a robot a new token; the broker refuses the old one after its next poll of the database
    (about 2 s).
    """
    token = new_token()
    user = "" if robot.credentials.credential_made_at is None else _new_user(robot)
    robot.enrolments.all().delete()
    _write(robot, NONE | _given(user, token, now))
    return Credentials(robot.name, token, user)


def rotate(robot: Robot, shown: str, now: datetime.datetime) -> Credentials | None:
    """Give a robot new credentials; those that it sent remain valid for GRACE.

    A robot that lost the answer repeats the request with its old credentials, which do not become
    valid for longer. Of two overlapping requests, one returns None: the robot uses the other's
    answer.
    """
    before, user, token = robot.credentials, _new_user(robot), new_token()
    changes = _given(user, token, now) | {"renewal_asked_at": None}
    if matches(shown, before.credential_hash):
        changes |= {
            "former_user": before.credential_user,
            "former_hash": before.credential_hash,
            "former_bcrypt_hash": before.bcrypt_hash,
            "former_until": now + GRACE,
        }
    is_first = _write(robot, changes, credential_hash=before.credential_hash)
    return Credentials(robot.name, token, user) if is_first else None


def ask_for_renewal(robot: Robot, now: datetime.datetime) -> None:
    """Have a robot fetch new credentials with its agent's next request, at the latest when the
    agent restarts.
    """
    _write(robot, {"renewal_asked_at": now})


def _new_user(robot: Robot) -> str:
    """Return a user for the robot's next credentials: a broker has one password for each user, and
    Mosquitto disconnects clients whose user was deleted, but not those whose password has changed.
    """
    return f"{robot.name}.{secrets.token_hex(4)}"


def _given(user: str, token: str, now: datetime.datetime) -> dict[str, Any]:
    return {
        "credential_user": user,
        "credential_hash": hash_token(token),
        "bcrypt_hash": bcrypt_hash(token),
        "credential_made_at": now,
    }


def _write(robot: Robot, changes: dict[str, Any], **only_if: str) -> bool:
    """Write these columns, if `only_if` still holds in the database; return whether it did."""
    rows = RobotCredentials.objects.filter(robot=robot, **only_if)
    if not rows.update(**changes):
        return False
    for name, value in changes.items():
        setattr(robot.credentials, name, value)
    return True


def revoke(robot: Robot) -> None:
    """Revoke a robot's tokens, also for enrolment; the broker disconnects it."""
    robot.enrolments.all().delete()
    _write(robot, NONE)


def keep_credentials(credentials: Credentials, path: Path, **addresses: str) -> None:
    """Write a credentials file that only its owner can read, for a robot on this machine."""
    path.parent.mkdir(parents=True, exist_ok=True)
    write_private(path, credentials.toml(**addresses))


def users_of(name: str, kept: RobotCredentials, now: datetime.datetime) -> dict[str, str]:
    """Return a robot's users at the broker and their hashes: the present one, and the former one
    while it is valid.
    """
    found = {kept.credential_user or name: kept.credential_hash}
    if kept.former_hash and kept.former_until is not None and now < kept.former_until:
        found[kept.former_user or name] = kept.former_hash
    return {user: credential_hash for user, credential_hash in found.items() if credential_hash}


def bcrypt_hashes_of(kept: RobotCredentials) -> dict[str, str]:
    """Return the bcrypt hash of each token by its other hash, "" if there is none yet."""
    return {kept.credential_hash: kept.bcrypt_hash, kept.former_hash: kept.former_bcrypt_hash}


def robot_of(name: str, token: str) -> Robot | None:
    """Return the enabled robot with these credentials, or None. An older token gets its bcrypt
    hash.
    """
    robot = Robot.objects.filter(name=name, enabled=True).select_related("credentials").first()
    if robot is None:
        return None
    hashes = users_of(name, robot.credentials, timezone.now()).values()
    found = next((one for one in hashes if matches(token, one)), None)
    if found is None:
        return None
    if not bcrypt_hashes_of(robot.credentials)[found]:
        # written only where the token's hash still is
        _write(robot, {"bcrypt_hash": bcrypt_hash(token)}, credential_hash=found)
        _write(robot, {"former_bcrypt_hash": bcrypt_hash(token)}, former_hash=found)
    return robot


def server_credentials(part: ServerPart) -> tuple[str, str]:
    """Return (user name, password) of a server process at the broker. The password is derived from
    the site's secret key, so that it need not be stored or copied.
    """
    digest = salted_hmac("robots.credentials.server", part, algorithm="sha256")
    return SERVER_USERS[part], digest.hexdigest()


def server_client_id(part: ServerPart, number: int = 0) -> str:
    """Return the MQTT client id of a server process with a persistent session: the same at every
    start, and secret, because with Mosquitto any user who knows the id can take over the session.
    Of several processes, each has a number.
    """
    name = f"{part}-{number}" if number else part
    digest = salted_hmac("robots.credentials.client_id", name, algorithm="sha256")
    return f"{part}-{digest.hexdigest()[:24]}"


def bearer(header: str) -> tuple[str, str]:
    """Return (robot, token) of an Authorization header, or empty texts."""
    scheme, _, rest = header.partition(" ")
    name, _, token = rest.strip().partition(":")
    return (name, token) if scheme.lower() == "bearer" and len(rest) < 512 else ("", "")
