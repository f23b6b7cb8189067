"""The stored description of a visitor's device."""

import pytest

from sessions.devices import device_of, headers_of_scope, network_of

WINDOWS = "Mozilla/5.0 (Windows NT 10.0; Win64; x64) AppleWebKit/537.36 (KHTML, like Gecko)"
AGENTS = [
    (f"{WINDOWS} Chrome/120.0.0.0 Safari/537.36", "Windows", "Chrome", "Chrome 120.0.0.0"),
    (
        f"{WINDOWS} Chrome/120.0.0.0 Safari/537.36 OPR/106.0.0.0",
        "Windows",
        "Opera",
        "Opera 106.0.0.0",
    ),
    (
        f"{WINDOWS} Chrome/120.0.0.0 Safari/537.36 Edg/120.0.2210.91",
        "Windows",
        "other",
        "Edge 120.0.2210.91",
    ),
    (
        "Mozilla/5.0 (X11; Linux x86_64; rv:128.0) Gecko/20100101 Firefox/128.0",
        "Linux",
        "Firefox",
        "Firefox 128.0",
    ),
    (
        (
            "Mozilla/5.0 (X11; Linux x86_64) AppleWebKit/537.36 Ubuntu Chromium/80.0 Chrome/80.0"
            " Safari/537.36"
        ),
        "Linux",
        "Chromium",
        "Chromium 80.0",
    ),
    (
        (
            "Mozilla/5.0 (Macintosh; Intel Mac OS X 10_15_7) AppleWebKit/605.1.15 Version/17.1"
            " Safari/605.1.15"
        ),
        "Mac OS",
        "other",
        "Safari 17.1",
    ),
    (
        (
            "Mozilla/5.0 (Linux; Android 14; Pixel 8) AppleWebKit/537.36 Chrome/120.0 Mobile"
            " Safari/537.36"
        ),
        "Android",
        "Chrome",
        "Chrome 120.0",
    ),
    (
        (
            "Mozilla/5.0 (iPhone; CPU iPhone OS 17_1 like Mac OS X) AppleWebKit/605.1.15"
            " CriOS/120.0 Mobile Safari/604.1"
        ),
        "iOS",
        "Chrome",
        "Chrome 120.0",
    ),
    (
        (
            "Mozilla/5.0 (iPad; CPU OS 17_1 like Mac OS X) AppleWebKit/605.1.15 FxiOS/120.0 Mobile"
            " Safari/605.1.15"
        ),
        "iOS",
        "Firefox",
        "Firefox 120.0",
    ),
    ("curl/8.5.0", "other", "other", "other"),
    ("", "other", "other", "other"),
]


@pytest.mark.parametrize(("agent", "system", "browser", "product"), AGENTS)
def test_system_and_browser_have_the_names_of_the_papers_table(agent, system, browser, product):
    device = device_of({"user-agent": agent}, "203.0.113.9")
    assert (device["os"], device["browser"], device["product"]) == (system, browser, product)
    assert device["mobile"] is ("Mobile" in agent)


def test_client_hints_tell_chromium_from_chrome():
    agent = AGENTS[0][0]
    hints = {
        "user-agent": agent,
        "sec-ch-ua": '"Chromium";v="128", "Not A(Brand";v="8"',
        "sec-ch-ua-platform": '"Linux"',
        "sec-ch-ua-mobile": "?0",
    }
    assert (device_of(hints, "")["os"], device_of(hints, "")["product"]) == (
        "Linux",
        "Chromium 128",
    )
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
def test_addresses_are_cut_before_they_are_kept(address, network):
    assert network_of(address) == network


def test_the_full_address_is_nowhere_in_what_is_kept():
    assert "203.0.113.77" not in str(device_of({"user-agent": "x"}, "203.0.113.77"))


@pytest.mark.parametrize(
    ("forwarded", "direct", "trusted", "network"),
    [
        ("198.51.100.7", "10.0.0.1", ["10.0.0.1"], "198.51.100.0/24"),
        # no proxy is trusted, and the header is ignored
        ("198.51.100.7", "10.0.0.1", [], "10.0.0.0/24"),
        # the visitor's own claim stands left
        ("6.6.6.6, 198.51.100.7", "10.0.0.1", ["10.0.0.0/8"], "198.51.100.0/24"),
        ("198.51.100.7, 10.0.0.9", "10.0.0.1", ["10.0.0.0/8"], "198.51.100.0/24"),
        ("6.6.6.6", "198.51.100.7", ["10.0.0.0/8"], "198.51.100.0/24"),
        ("nonsense, , ", "10.0.0.1", ["10.0.0.1"], ""),
    ],
)
def test_forwarded_addresses_are_believed_from_trusted_proxies_alone(
    forwarded, direct, trusted, network
):
    assert device_of({"x-forwarded-for": forwarded}, direct, trusted)["network"] == network


def test_long_user_agents_are_cut():
    assert len(device_of({"user-agent": "x" * 10_000}, "")["user_agent"]) == 400


def test_headers_come_from_an_asgi_scope():
    assert headers_of_scope({"headers": [(b"User-Agent", b"caf\xe9")]}) == {"user-agent": "café"}
