"""ASGI entry point: HTTP to Django, WebSockets to the consumers."""

import os

from channels.auth import AuthMiddlewareStack
from channels.routing import ProtocolTypeRouter, URLRouter
from channels.security.websocket import AllowedHostsOriginValidator
from django.conf import settings
from django.core.asgi import get_asgi_application
from django.urls import get_resolver
from whitenoise.middleware import WhiteNoiseMiddleware

os.environ.setdefault("DJANGO_SETTINGS_MODULE", "telepresence_site.settings")
http = get_asgi_application()

from robots.process.interpreter import set_up_for_latency
from sessions.backpressure import Backpressure
from sessions.urls import websocket_urlpatterns
from telepresence_site.web.asgi_limits import (
    BodyLimit,
    ConnectLimit,
    KnownPaths,
    OpenLimit,
    SameOrigin,
    address_of,
    user_of,
)
from telepresence_site.web.request_log import RequestLog
from telepresence_site.web.shutdown import bound_exit
from telepresence_site.web.static_answers import StaticAnswers

pages = OpenLimit(URLRouter(websocket_urlpatterns), settings.SOCKETS_PER_USER, user_of)
# Refuses another site's Origin, and a missing one.
own_pages = SameOrigin(
    AuthMiddlewareStack(pages),
    settings.CSRF_TRUSTED_ORIGINS,
    secure_only=settings.SECURE_SSL_REDIRECT,
)
counted = OpenLimit(
    AllowedHostsOriginValidator(own_pages),
    settings.SOCKETS_PER_ADDRESS,
    lambda scope: address_of(scope, settings.TRUSTED_PROXIES),
)
sockets = ConnectLimit(KnownPaths(counted, websocket_urlpatterns), settings.TRUSTED_PROXIES)

static_files = WhiteNoiseMiddleware(lambda _: None).files
application = ProtocolTypeRouter(
    {
        "http": RequestLog(
            BodyLimit(StaticAnswers(http, static_files, secure_only=settings.SECURE_SSL_REDIRECT))
        ),
        "websocket": Backpressure(RequestLog(sockets)),
    }
)

# Load addresses, forms and administration now and not with the first page.
get_resolver().url_patterns  # noqa: B018 -- reading it loads them
set_up_for_latency()
bound_exit()
