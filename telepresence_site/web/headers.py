"""What a browser is told about every answer, beside what Django and django-csp tell it."""

from collections.abc import Callable

from django.http import HttpRequest
from django.http.response import HttpResponseBase

# Camera, microphone and screen are for what a visitor shows of themselves, and for no page within
# ours; of the rest nothing is used.
UNUSED = (
    "accelerometer",
    "browsing-topics",
    "geolocation",
    "gyroscope",
    "hid",
    "idle-detection",
    "local-fonts",
    "magnetometer",
    "midi",
    "payment",
    "publickey-credentials-get",
    "serial",
    "usb",
    "xr-spatial-tracking",
)
PERMISSIONS = ", ".join(
    [
        "camera=(self)",
        "microphone=(self)",
        "display-capture=(self)",
        "fullscreen=(self)",
        *(f"{name}=()" for name in UNUSED),
    ]
)


class PrivateAnswers:
    """Middleware, the outermost: no other site embeds our answers, and what is somebody's own is
    kept by no cache.

    A view that says itself how long its answer may be kept (photos, maps) is left alone; static
    files are no view's.
    """

    def __init__(self, get_response: Callable[[HttpRequest], HttpResponseBase]) -> None:
        self._get_response = get_response

    def __call__(self, request: HttpRequest) -> HttpResponseBase:
        response = self._get_response(request)
        response.headers.setdefault("Permissions-Policy", PERMISSIONS)
        response.headers.setdefault("Cross-Origin-Resource-Policy", "same-origin")
        if not response.has_header("Cache-Control") and _is_personal(request):
            response.headers["Cache-Control"] = "private, no-store"
        return response


def _is_personal(request: HttpRequest) -> bool:
    """Tell whether the session was looked at: then the answer may hold what only this browser is to
    see.
    """
    session = getattr(request, "session", None)
    return session is not None and session.accessed
