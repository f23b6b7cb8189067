"""The stored form of secret links and keys."""

from hashlib import sha256


def hash_of(token: str) -> str:
    """Return the SHA-256 of a token in hexadecimal. Without a salt it suits only tokens of 128
    random bits or more, which cannot be found from their hash.
    """
    return sha256(token.encode()).hexdigest()
