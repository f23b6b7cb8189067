"""Views from which an agent gets credentials, by a one-time token, and renews them. POST only, no
cookies.
"""

from typing import Any

import msgspec
import structlog
from django.http import HttpRequest, JsonResponse
from django.utils import timezone
from django.views.decorators.cache import never_cache
from django.views.decorators.csrf import csrf_exempt
from django.views.decorators.http import require_POST

from accounts import audit
from accounts.attempts import Attempts
from accounts.rate_limits import limited
from robots.enrol import credentials, tokens
from robots.enrol.credentials import Credentials, bearer
from robots.enrol.elsewhere import MISDIRECTED, misdirected

log = structlog.stdlib.get_logger(__name__)
MAX_BODY = 4096  # bytes
ENROLLING, RENEWING = Attempts("enrol", limit=10), Attempts("renew", limit=20)


class EnrolmentRequest(msgspec.Struct):
    robot: str
    token: str


@csrf_exempt
@never_cache
@require_POST
@limited(ENROLLING, json=True, refusals={400, 403, MISDIRECTED})
def enrol(request: HttpRequest) -> JsonResponse:
    """Exchange a one-time token for credentials: {"robot", "token"} in, {"robot", "token"} out."""
    try:
        asked = msgspec.json.decode(request.body[:MAX_BODY], type=EnrolmentRequest)
    except (msgspec.DecodeError, RecursionError):
        return _refusal(400, "malformed", "Send a JSON object with robot and token.")
    made = tokens.redeem(asked.robot, asked.token, timezone.now())
    if made is None:
        log.warning("enrolment_refused", robot=asked.robot[:80])
        if (elsewhere := misdirected(asked.robot)) is not None:
            return elsewhere
        detail = (
            "This token was used, has expired, or is another robot's. A robot that has connected"
            " before needs none: leave --enrol out. Else its owner can make a new one in the"
            " administration."
        )
        return _refusal(403, "unknown_token", detail)
    audit.note("robot_enrolled", robot=asked.robot)
    return JsonResponse(_as_json(made))


@csrf_exempt
@never_cache
@require_POST
@limited(RENEWING, json=True, refusals={401, MISDIRECTED})
def renew(request: HttpRequest) -> JsonResponse:
    """Give an agent new credentials, if the owner requested that; those that it sent remain valid
    for a while.
    """
    name, token = bearer(request.headers.get("Authorization", ""))
    robot = credentials.robot_of(name, token) if name and token else None
    if robot is None:
        detail = "These credentials are not valid, or no longer valid."
        return misdirected(name) or _refusal(401, "wrong_credentials", detail)
    is_former = not credentials.matches(token, robot.credentials.credential_hash)
    if robot.credentials.renewal_asked_at is None and not is_former:
        return JsonResponse({"robot": robot.name})
    made = credentials.rotate(robot, token, timezone.now())
    if made is None:
        return _refusal(409, "busy", "Another renewal of this robot was faster.")
    audit.note("credentials_rotated", robot=robot.name)
    return JsonResponse(_as_json(made))


def _refusal(status: int, error: str, detail: str) -> JsonResponse:
    return JsonResponse({"error": error, "detail": detail}, status=status)


def _as_json(made: Credentials) -> dict[str, Any]:
    return {"robot": made.robot, "user": made.user or made.robot, "token": made.token}
