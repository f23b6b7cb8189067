"""The stored description of a visitor's device."""

import pytest

from sessions.devices import device_of, headers_of_scope, network_of

KIT = "AppleWebKit/537.36 (KHTML, like Gecko)"
WINDOWS = f"Windows NT 10.0; Win64; x64) {KIT} Chrome/120.0.0.0 Safari/537.36"
# by (system, browser, product); each begins with "Mozilla/5.0 ("
AGENTS = {
    ("Windows", "Chrome", "Chrome 120.0.0.0"): WINDOWS,
    ("Windows", "Opera", "Opera 106.0.0.0"): f"{WINDOWS} OPR/106.0.0.0",
    ("Windows", "other", "Edge 120.0.2210.91"): f"{WINDOWS} Edg/120.0.2210.91",
    ("Linux", "Firefox", "Firefox 128.0"): "X11; Linux x86_64; rv:128.0) Gecko/1 Firefox/128.0",
    ("Linux", "Chromium", "Chromium 80.0"): f"X11; Linux) {KIT} Ubuntu Chromium/80.0 Chrome/80.0",
    ("Mac OS", "other", "Safari 17.1"): f"Macintosh; Mac OS X) {KIT} Version/17.1 Safari/605.1",
    ("Android", "Chrome", "Chrome 120.0"): f"Linux; Android 14; P) {KIT} Chrome/120.0 Mobile",
    ("iOS", "Chrome", "Chrome 120.0"): f"iPhone; like Mac OS X) {KIT} CriOS/120.0 Mobile Safari/6",
    ("iOS", "Firefox", "Firefox 120.0"): f"iPad; like Mac OS X) {KIT} FxiOS/120.0 Mobile Safari/6",
}


@pytest.mark.parametrize(("names", "agent"), AGENTS.items())
def test_system_and_browser_have_the_names_of_the_papers_table(names, agent):
    device = device_of({"user-agent": f"Mozilla/5.0 ({agent}"}, "203.0.113.9")
    assert (device["os"], device["browser"], device["product"]) == names
    assert device["mobile"] is ("Mobile" in agent)


@pytest.mark.parametrize("agent", ["curl/8.5.0", ""])
def test_unknown_user_agents_are_other(agent):
    device = device_of({"user-agent": agent}, "203.0.113.9")
    assert {device["os"], device["browser"], device["product"]} == {"other"}


def test_client_hints_distinguish_chromium_from_chrome():
    hints = {
        "user-agent": f"Mozilla/5.0 ({WINDOWS}",
        "sec-ch-ua": '"Chromium";v="128", "Not A(Brand";v="8"',
        "sec-ch-ua-platform": '"Linux"',
        "sec-ch-ua-mobile": "?0",
    }
    device = device_of(hints, "")
    assert (device["os"], device["product"]) == ("Linux", "Chromium 128")
    hints["sec-ch-ua"] = '"Chromium";v="128", "Google Chrome";v="128", "Not A(Brand";v="8"'
    assert device_of(hints, "")["browser"] == "Chrome"


@pytest.mark.parametrize(
    ("address", "network"),
    [
        ("203.0.113.77", "203.0.113.0/24"),
        ("2001:db8:1:2:3::4", "2001:db8:1::/48"),
        ("::ffff:203.0.113.77", "203.0.113.0/24"),
        ("fe80::1%eth0", "fe80::/48"),
        ("nonsense", ""),
        ("", ""),
    ],
)
def test_addresses_are_truncated_before_they_are_stored(address, network):
    assert network_of(address) == network


def test_the_full_address_is_not_stored():
    assert "203.0.113.77" not in str(device_of({"user-agent": "x"}, "203.0.113.77"))


@pytest.mark.parametrize(
    ("forwarded", "direct", "trusted", "network"),
    [
        ("198.51.100.7", "10.0.0.1", ["10.0.0.1"], "198.51.100.0/24"),
        # no proxy is trusted, and the header is ignored
        ("198.51.100.7", "10.0.0.1", [], "10.0.0.0/24"),
        # the leftmost address is the visitor's own claim
        ("6.6.6.6, 198.51.100.7", "10.0.0.1", ["10.0.0.0/8"], "198.51.100.0/24"),
        ("198.51.100.7, 10.0.0.9", "10.0.0.1", ["10.0.0.0/8"], "198.51.100.0/24"),
        ("6.6.6.6", "198.51.100.7", ["10.0.0.0/8"], "198.51.100.0/24"),
        ("nonsense, , ", "10.0.0.1", ["10.0.0.1"], ""),
    ],
)
def test_only_trusted_proxies_forward_an_address(forwarded, direct, trusted, network):
    assert device_of({"x-forwarded-for": forwarded}, direct, trusted)["network"] == network


def test_long_user_agents_are_truncated():
    assert len(device_of({"user-agent": "x" * 10_000}, "")["user_agent"]) == 400


def test_headers_come_from_an_asgi_scope():
    assert headers_of_scope({"headers": [(b"User-Agent", b"caf\xe9")]}) == {"user-agent": "café"}
