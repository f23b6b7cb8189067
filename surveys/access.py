"""Who may see which response: its own respondent, and nobody else. For all others
it is not there.
"""

from uuid import UUID

from django.http import Http404, HttpRequest

from surveys.models import Response


def own_response(request: HttpRequest, pk: UUID) -> Response:
    """Return a response of whoever asks and is signed in.

    Raises:
        Http404: when there is none, or it is somebody else's.
    """
    row = Response.objects.select_related("questionnaire").filter(pk=pk).first()
    if row is None or row.user_id is None or row.user_id != request.user.pk:
        raise Http404
    return row
