"""Compresses visitors' pages, but no pages that show secrets.

The size of a compressed page reveals how much of it repeats what its reader sent, and so a secret
in it byte by byte (BREACH). The CSRF token is masked differently in every answer, and Django adds
random bytes. Credentials, keys and invitations are shown in the administration and in answers to
forms, which are sent uncompressed. WhiteNoise compresses static files in advance.

    https://www.breachattack.com/
    https://docs.djangoproject.com/en/5.2/ref/csrf/#how-it-works
"""

from django.http import HttpRequest
from django.http.response import HttpResponseBase
from django.middleware.gzip import GZipMiddleware


class CompressedPages(GZipMiddleware):
    def process_response(
        self, request: HttpRequest, response: HttpResponseBase
    ) -> HttpResponseBase:
        is_page = response.headers.get("Content-Type", "").startswith("text/html")
        is_form_answer = request.method not in {"GET", "HEAD"}
        found = request.resolver_match
        is_administration = found is not None and "admin" in found.namespaces
        if not is_page or is_form_answer or is_administration:
            return response
        return super().process_response(request, response)
