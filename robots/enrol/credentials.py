"""Keys to the broker: random 256-bit tokens, shown once, kept only as hashes.

The hash has Mosquitto's own form, `$7$<iterations>$<salt>$<hash>` (PBKDF2 with SHA-512, base64), so
that one string in the database serves Mosquitto's password file and the HTTPS endpoint alike. NATS
reads only bcrypt: for it a second hash is made of each token, and of older tokens when an agent
shows one (`robot_of`).

A token of 256 random bits cannot be guessed, so the iterations protect nothing; there are as few as
`mosquitto_passwd` makes, and as bcrypt allows, because a broker checks them between two messages.
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

import bcrypt
from django.utils import timezone
from django.utils.crypto import salted_hmac

from robots.api.credentials_file import toml
from robots.api.private_files import write_private
from robots.models import Robot, RobotCredentials

TOKEN_BYTES = 32
ITERATIONS = 101
SALT_BYTES = 12  # the one length that Mosquitto reads
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

# A robot's name has no dot, so that no robot can be called like a server.
ServerPart = Literal["web", "session-manager"]
SERVER_USERS: dict[ServerPart, str] = {
    "web": "server.web",
    "session-manager": "server.session-manager",
}


@dataclass(frozen=True)
class Credentials:
    """What a robot's computer needs besides the server's address; the token is here for the only
    time.
    """

    robot: str
    token: str = field(repr=False)
    user: str = ""  # at the broker, when that is not the robot's name

    def toml(self, **addresses: str) -> str:
        """Return the credentials file of `run_robot`; `addresses` are further lines, such as
        `server` or `mqtt_url`.
        """
        return toml(
            {
                "robot": self.robot,
                **({"user": self.user} if self.user else {}),
                "token": self.token,
                **addresses,
            }
        )


def new_token() -> str:
    """Return 256 random bits as text that survives shells, URLs and MQTT, and that no command takes
    for an option of its own.
    """
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
    salt = secrets.token_bytes(BCRYPT_SALT_BYTES) if salt is None else salt[:BCRYPT_SALT_BYTES]
    letters = base64.b64encode(salt).rstrip(b"=").translate(TO_BCRYPT)
    return bcrypt.hashpw(token.encode(), b"$2b$%02d$%s" % (BCRYPT_COST, letters)).decode()


def matches(token: str, credential_hash: str) -> bool:
    """Tell whether a token has this hash; an empty or malformed hash matches nothing."""
    try:
        empty, kind, iterations, salt, digest = credential_hash.split("$")
        count, expected = int(iterations), base64.b64decode(digest, validate=True)
        found = hashlib.pbkdf2_hmac(
            "sha512",
            token.encode(),
            base64.b64decode(salt, validate=True),
            min(count, MAX_ITERATIONS),
            HASH_BYTES,
        )
    except (ValueError, binascii.Error):
        return False
    return (
        not empty
        and kind == "7"
        and 0 < count <= MAX_ITERATIONS
        and hmac.compare_digest(found, expected)
    )


def make_credentials(robot: Robot, now: datetime.datetime) -> Credentials:
    """Give a robot a new token; the old one is worthless from the broker's next look at the
    database on (about 2 s).
    """
    token = new_token()
    user = "" if robot.credentials.credential_made_at is None else _new_user(robot)
    robot.enrolments.all().delete()
    _write(robot, NONE | _given(user, token, now))
    return Credentials(robot.name, token, user)


def rotate(robot: Robot, shown: str, now: datetime.datetime) -> Credentials | None:
    """Give a robot new credentials while those that it showed hold for GRACE longer.

    A robot that lost the answer asks again with what it has, and that holds no longer for it. Of
    two requests that overlap, one is answered with None: the robot keeps the answer to the other.
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
    """Have a robot fetch new credentials the next time that its agent asks, at the latest when it
    starts again.
    """
    _write(robot, {"renewal_asked_at": now})


def _new_user(robot: Robot) -> str:
    """Return a user for the robot's next credentials.

    A broker knows one password a user, and Mosquitto parts with a client whose user is gone, but
    not with one whose password is another.
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
    """Write these columns, if the row is as the caller read it; return whether it was."""
    rows = RobotCredentials.objects.filter(robot=robot, **only_if)
    if not rows.update(**changes):
        return False
    for name, value in changes.items():
        setattr(robot.credentials, name, value)
    return True


def revoke(robot: Robot) -> None:
    """Take a robot's tokens away, also one with which it could enrol; the broker disconnects it."""
    robot.enrolments.all().delete()
    _write(robot, NONE)


def keep_credentials(credentials: Credentials, path: Path, **addresses: str) -> None:
    """Write a credentials file that only its owner can read (for a robot on the server's own
    machine).
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    write_private(path, credentials.toml(**addresses))


def users_of(name: str, kept: RobotCredentials, now: datetime.datetime) -> dict[str, str]:
    """Return the users at the broker that are the robot of this name, and their hashes: its own,
    and the former while that still holds.
    """
    found = {kept.credential_user or name: kept.credential_hash}
    if kept.former_hash and kept.former_until is not None and now < kept.former_until:
        found[kept.former_user or name] = kept.former_hash
    return {user: credential_hash for user, credential_hash in found.items() if credential_hash}


def bcrypt_hashes_of(kept: RobotCredentials) -> dict[str, str]:
    """Return the bcrypt hash beside each other hash of a robot, "" where there is none yet."""
    return {kept.credential_hash: kept.bcrypt_hash, kept.former_hash: kept.former_bcrypt_hash}


def robot_of(name: str, token: str) -> Robot | None:
    """Return the enabled robot that these credentials belong to, or None. A token of before there
    were bcrypt hashes gets its own.
    """
    robot = Robot.objects.filter(name=name, enabled=True).select_related("credentials").first()
    if robot is None:
        return None
    fits = [
        credential_hash
        for credential_hash in users_of(name, robot.credentials, timezone.now()).values()
        if matches(token, credential_hash)
    ]
    if fits and not bcrypt_hashes_of(robot.credentials)[fits[0]]:
        # unless the credentials have changed since they were read
        for kept, added in (
            ("credential_hash", "bcrypt_hash"),
            ("former_hash", "former_bcrypt_hash"),
        ):
            _write(robot, {added: bcrypt_hash(token)}, **{kept: fits[0]})
    return robot if fits else None


def server_credentials(part: ServerPart) -> tuple[str, str]:
    """Return (user name, password) of a server process at the broker.

    The password comes from the site's secret key, which all server processes share, and changes
    with it: nothing to store or copy.
    """
    return (
        SERVER_USERS[part],
        salted_hmac("robots.credentials.server", part, algorithm="sha256").hexdigest(),
    )


def server_client_id(part: ServerPart, number: int = 0) -> str:
    """Return the MQTT client id of a server process that keeps a persistent session: the same at
    every start, and not to be guessed. Of several processes each has a number.

    With Mosquitto a client id is all it takes to take a session over, whoever one is; so ids are
    secrets or random.
    """
    name = f"{part}-{number}" if number else part
    digest = salted_hmac("robots.credentials.client_id", name, algorithm="sha256")
    return f"{part}-{digest.hexdigest()[:24]}"


def bearer(header: str) -> tuple[str, str]:
    """Return (robot, token) of an Authorization header, empty when there is none."""
    scheme, _, rest = header.partition(" ")
    name, _, token = rest.strip().partition(":")
    return (name, token) if scheme.lower() == "bearer" and len(rest) < 512 else ("", "")
