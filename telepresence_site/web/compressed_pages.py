"""Visitors' pages are compressed; pages that show secrets are not.

How well a page is compressed tells how much of it repeats what its reader sent, which can reveal a
secret in it byte by byte (BREACH). The CSRF token is masked anew in every answer, and Django adds
random bytes. Credentials, keys and invitations are shown in the administration and in answers to
forms, and these go out as they are. Static files are compressed beforehand, by WhiteNoise.

    https://www.breachattack.com/
    https://docs.djangoproject.com/en/5.2/ref/csrf/#how-it-works
"""

from django.http import HttpRequest
from django.http.response import HttpResponseBase
from django.middleware.gzip import GZipMiddleware


class CompressedPages(GZipMiddleware):
    """Django's compression, for HTML that shows no secret."""

    def process_response(
        self, request: HttpRequest, response: HttpResponseBase
    ) -> HttpResponseBase:
        """Return the answer, compressed where that is safe and the browser can read it."""
        is_page = response.headers.get("Content-Type", "").startswith("text/html")
        is_form_answer = request.method not in {"GET", "HEAD"}
        found = request.resolver_match
        is_administration = found is not None and "admin" in found.namespaces
        if not is_page or is_form_answer or is_administration:
            return response
        return super().process_response(request, response)
