"""Third-party apps, with keys that MongoDB generates."""

from allauth.account.apps import AccountConfig as Account
from django.contrib.auth.apps import AuthConfig as Auth
from django.contrib.contenttypes.apps import ContentTypesConfig as ContentTypes

from telepresence_site.mongodb import KEY
from telepresence_site.web.administration import AdminConfig as Admin


class MongoAdminConfig(Admin):
    default_auto_field = KEY


class AuthConfig(Auth):
    default_auto_field = KEY


class ContentTypesConfig(ContentTypes):
    default_auto_field = KEY


class AccountConfig(Account):
    default_auto_field = KEY
