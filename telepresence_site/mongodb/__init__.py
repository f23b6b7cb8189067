"""The settings of a site on MongoDB: keys that are not UUIDs are ObjectIds, and third-party apps
use our migrations, because theirs create integer keys, which MongoDB does not generate.
docs/howto/mongodb.md says what works.
"""

from typing import Any
from urllib.parse import urlsplit

SCHEMES = ("mongodb://", "mongodb+srv://")
KEY = "django_mongodb_backend.fields.ObjectIdAutoField"
NAME = "telepresence"  # of the database, when the address does not say
_APPS = {
    "telepresence_site.web.administration.AdminConfig": (
        "telepresence_site.mongodb.apps.MongoAdminConfig"
    ),
    "django.contrib.auth": "telepresence_site.mongodb.apps.AuthConfig",
    "django.contrib.contenttypes": "telepresence_site.mongodb.apps.ContentTypesConfig",
    "allauth.account": "telepresence_site.mongodb.apps.AccountConfig",
}
MIGRATION_MODULES = {
    label: f"telepresence_site.mongodb.migrations.{label}"
    for label in ("admin", "auth", "contenttypes", "account")
}


def is_address(url: str) -> bool:
    return url.startswith(SCHEMES)


def database(url: str) -> dict[str, Any]:
    """Return Django's settings for the database; pymongo reads the address itself."""
    return {
        "ENGINE": "django_mongodb_backend",
        "HOST": url,
        "NAME": urlsplit(url).path.strip("/") or NAME,
    }


def apps(installed: list[str]) -> list[str]:
    """Return INSTALLED_APPS with the configurations that MongoDB needs."""
    return [_APPS.get(name, name) for name in installed]
