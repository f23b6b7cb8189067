"""A visitor's device: operating system and browser by the names of the paper's Table 3, and a
truncated address.

The user agent is a guess that browsers make hard on purpose; where the browser sends client hints
(Chrome, Chromium, Opera, Edge over HTTPS) they are believed first, because only they tell Chromium
from Chrome.
"""

import ipaddress
import re
from collections.abc import Iterable, Mapping
from typing import Any

from accounts.client_address import parse_address, visitor_address

OTHER = "other"
_SYSTEMS = (
    ("Android", "Android"),
    ("iPhone|iPad|iPod", "iOS"),
    ("Windows", "Windows"),
    ("Mac OS X|Macintosh", "Mac OS"),
    ("Linux|X11", "Linux"),
)
# Table 3's names, of systems and of browsers.
SYSTEMS = frozenset(name for _, name in _SYSTEMS)
# by the client hint Sec-CH-UA-Platform
_PLATFORMS = {name: name for name in SYSTEMS} | {"macOS": "Mac OS"}
# In this order: browsers also claim to be those further down.
_AGENTS = (
    (r"(?:OPR|Opera|OPT|OPiOS)/([\d.]+)", "Opera"),
    (r"(?:Edg|EdgA|EdgiOS|Edge)/([\d.]+)", "Edge"),
    (r"SamsungBrowser/([\d.]+)", "Samsung Internet"),
    (r"(?:Firefox|FxiOS)/([\d.]+)", "Firefox"),
    (r"(?:Ubuntu )?Chromium/([\d.]+)", "Chromium"),
    (r"(?:Headless)?(?:Chrome|CriOS)/([\d.]+)", "Chrome"),
    (r"Version/([\d.]+).*Safari/", "Safari"),
)
_BRANDS = (
    ("Opera", "Opera"),
    ("Microsoft Edge", "Edge"),
    ("Google Chrome", "Chrome"),
    ("Chromium", "Chromium"),
)
TABLE_3_BROWSERS = frozenset({"Chrome", "Firefox", "Chromium", "Opera"})
_BRAND = re.compile(r'"([^"]{1,60})";\s*v="([\d.]{1,20})"')
MAX_AGENT = 400


def device_of(
    headers: Mapping[str, str], address: str, trusted_proxies: Iterable[str] = ()
) -> dict[str, Any]:
    """Return the stored description of a device.

    Args:
        headers: of the request, with lower-case names.
        address: of the peer of our connection.
        trusted_proxies: addresses or networks whose X-Forwarded-For is believed.

    Returns:
        `os` and `browser` in Table 3's names or `other`, `product` the browser's own name and
        version, `mobile`, `user_agent`, and
        `network`: the visitor's address cut to /24 (IPv4) or /48 (IPv6).
    """
    agent = headers.get("user-agent", "")[:MAX_AGENT]
    name, version = _browser(agent, headers.get("sec-ch-ua", ""))
    return {
        "os": _system(agent, headers.get("sec-ch-ua-platform", "")),
        "browser": name if name in TABLE_3_BROWSERS else OTHER,
        "product": f"{name} {version}".strip(),
        "mobile": headers.get("sec-ch-ua-mobile") == "?1" or "Mobi" in agent,
        "user_agent": agent,
        "network": network_of(
            visitor_address(headers.get("x-forwarded-for", ""), address, trusted_proxies)
        ),
    }


def headers_of_scope(scope: Mapping[str, Any]) -> dict[str, str]:
    """Return the headers of an ASGI scope with lower-case names."""
    return {
        name.decode("latin-1").lower(): value.decode("latin-1")
        for name, value in scope.get("headers", ())
    }


def _system(agent: str, platform: str) -> str:
    hinted = _PLATFORMS.get(platform.strip('" '))
    return hinted or next((name for pattern, name in _SYSTEMS if re.search(pattern, agent)), OTHER)


def _browser(agent: str, brands: str) -> tuple[str, str]:
    hinted = dict(_BRAND.findall(brands[:MAX_AGENT]))
    for brand, name in _BRANDS:
        if brand in hinted:
            return name, hinted[brand]
    for pattern, name in _AGENTS:
        if found := re.search(pattern, agent):
            return name, found.group(1)
    return OTHER, ""


def network_of(address: str) -> str:
    """Return an address cut to /24 or /48; empty if it is malformed."""
    found = parse_address(address)
    if found is None:
        return ""
    return str(ipaddress.ip_network((found, 24 if found.version == 4 else 48), strict=False))
