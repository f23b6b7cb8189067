"""Hashes of tokens for NATS: bcrypt, from the system's libcrypt.

Debian's libcrypt (libxcrypt) has bcrypt. Python 3.13 has no `crypt` module, and one function is not
worth a dependency. Where libcrypt has no bcrypt (macOS), there is no hash, and the files for NATS
leave that user out.

The tokens have 256 random bits, so the lowest cost of bcrypt is enough.
"""

import ctypes
import ctypes.util
import secrets
from functools import cache
from typing import Any

COST = 4
ALPHABET = "./ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789"
SALT_LETTERS = 22
HASH_LETTERS = 60
LAST_SALT_LETTERS = ".Oeu"  # of the last letter only two bits count


def bcrypt_hash(token: str, *, salt: bytes | None = None) -> str:
    """Return the hash of a token in the `$2b$` form, "" if the system has no bcrypt; `salt` has 22
    bytes.
    """
    crypt = _crypt()
    if crypt is None:
        return ""
    letters = _letters(secrets.token_bytes(SALT_LETTERS) if salt is None else salt)
    found: bytes | None = crypt(token.encode(), f"$2b${COST:02}${letters}".encode())
    text = (found or b"").decode("ascii", "replace")
    return text if text.startswith("$2b$") and len(text) == HASH_LETTERS else ""


def _letters(salt: bytes) -> str:
    front = "".join(ALPHABET[byte % len(ALPHABET)] for byte in salt[: SALT_LETTERS - 1])
    return front + LAST_SALT_LETTERS[salt[SALT_LETTERS - 1] % len(LAST_SALT_LETTERS)]


@cache
def _crypt() -> Any:
    """Return libcrypt's `crypt`, or None. It is called with the interpreter's lock (PyDLL), because
    it returns a buffer that all threads share.
    """
    name = ctypes.util.find_library("crypt")
    if name is None:
        return None
    try:
        crypt = ctypes.PyDLL(name).crypt
    except (OSError, AttributeError):
        return None
    crypt.argtypes, crypt.restype = [ctypes.c_char_p, ctypes.c_char_p], ctypes.c_char_p
    return crypt
