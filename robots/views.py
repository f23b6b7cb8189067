"""Views for a robot's agent before it connects, and for the maps of pages."""

import hashlib
import time

import msgspec
from django.conf import settings
from django.http import Http404, HttpRequest, HttpResponse, HttpResponseBase, JsonResponse
from django.http.request import split_domain_port
from django.shortcuts import get_object_or_404
from django.utils.cache import get_conditional_response
from django.views.decorators.cache import never_cache
from django.views.decorators.csrf import csrf_exempt
from django.views.decorators.http import require_GET, require_safe

from accounts.attempts import Attempts, address_of
from accounts.passwordless import open_to_visitors
from accounts.rate_limits import too_many
from robots.access import may_drive, may_observe, robots_visible_to
from robots.enrol import credentials
from robots.enrol.elsewhere import misdirected
from robots.ice import ice_servers
from robots.models import FloorPlan
from robots.plans.floorplans import plan_content

ASKED = Attempts("agent", limit=120)
REFUSED = Attempts("agent-refused", limit=20)
YEAR = 365 * 24 * 3600


@csrf_exempt
@never_cache
@require_GET
def agent_configuration(request: HttpRequest) -> JsonResponse:
    """Return the addresses of broker and ICE servers to an agent, which sends `Authorization:
    Bearer <robot>:<token>`, without session and cookie.
    """
    address, now = address_of(request), time.time()
    if not REFUSED.are_left(address, now) or not ASKED.count(address, now):
        wait = max(REFUSED.wait(address, now), ASKED.wait(address, now))
        return too_many(request, wait, json=True)
    name, token = credentials.bearer(request.headers.get("Authorization", ""))
    robot = credentials.robot_of(name, token) if name and token else None
    if robot is None:
        REFUSED.count(address, now)
        if (elsewhere := misdirected(name)) is not None:
            return elsewhere
        detail = (
            "Send “Authorization: Bearer <robot>:<token>” with the credentials that the robot's"
            " owner was shown."
        )
        return JsonResponse(
            {"error": "wrong_credentials", "detail": detail},
            status=401,
            headers={"WWW-Authenticate": "Bearer"},
        )
    servers = [msgspec.to_builtins(server) for server in ice_servers(robot.name, now)]
    urls = mqtt_urls_for(request)
    return JsonResponse(
        {"robot": robot.name, "mqttUrl": urls[0], "mqttUrls": urls, "iceServers": servers}
    )


def mqtt_urls_for(request: HttpRequest) -> list[str]:
    """Return the addresses of the broker for robots, the best first; `{host}` in the setting
    becomes the host of the request.
    """
    host, _ = split_domain_port(request.get_host())
    return [
        url.strip().replace("{host}", host)
        for url in (settings.MQTT_PUBLIC_URL or settings.MQTT_URL).split(",")
    ]


@open_to_visitors
@require_safe
def floor_plan(request: HttpRequest, name: str) -> HttpResponseBase:
    """Answer with a map as JSON, without its image."""
    if not request.user.is_authenticated:
        return JsonResponse({"error": "not_signed_in"}, status=403)
    response = JsonResponse(plan_content(_visible_plan(request, name)))
    response["Cache-Control"] = "private, no-cache"
    return _tagged(request, response)


@open_to_visitors
@require_safe
def floor_plan_image(request: HttpRequest, name: str) -> HttpResponseBase:
    """Answer with the image of a map, row 0 on top."""
    if not request.user.is_authenticated:
        return HttpResponse(status=403)
    plan = _visible_plan(request, name)
    response = HttpResponse(bytes(plan.image), content_type="image/png")
    response["Cache-Control"] = (
        f"private, max-age={YEAR}, immutable"
        if request.GET.get("v") == plan.sha256[:16]
        else "private, no-cache"
    )
    return _tagged(request, response)


def _tagged(request: HttpRequest, response: HttpResponse) -> HttpResponseBase:
    """Return the response, or 304 if the browser has it."""
    response["ETag"] = f'"{hashlib.sha256(response.content).hexdigest()}"'
    return get_conditional_response(request, response["ETag"], None, response) or response


def _visible_plan(request: HttpRequest, name: str) -> FloorPlan:
    plan = get_object_or_404(FloorPlan, name=name)
    robots = robots_visible_to(request.user).filter(floor_plan=plan)
    if request.user.is_staff or any(
        may_observe(request.user, robot) or may_drive(request.user, robot) for robot in robots
    ):
        return plan
    raise Http404
