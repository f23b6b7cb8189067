"""STUN and TURN servers, with credentials that end."""

import base64
import hashlib
import hmac

from robots.ice import LIFETIME_SECONDS, ice_servers, relays_by_region


def test_without_servers_the_list_is_empty_and_never_a_public_default(settings):
    settings.STUN_URLS, settings.TURN_URLS, settings.TURN_SECRET = [], [], ""
    assert ice_servers("visitor", 0.0) == ()


def test_turn_credentials_are_the_ones_that_coturn_checks(settings):
    settings.STUN_URLS = ["stun:turn.example.org"]
    settings.TURN_URLS = ["turn:turn.example.org", "turns:turn.example.org?transport=tcp"]
    settings.TURN_SECRET = "secret"
    stun, turn = ice_servers("visitor", 1_000_000.7)
    assert stun.urls == ("stun:turn.example.org",)
    assert stun.username == ""
    assert turn.urls == tuple(settings.TURN_URLS)
    assert turn.username == f"{1_000_000 + LIFETIME_SECONDS}:visitor"
    expected = hmac.new(b"secret", turn.username.encode(), hashlib.sha1).digest()
    assert base64.b64decode(turn.credential) == expected


def test_a_turn_server_without_its_secret_is_left_out(settings):
    settings.STUN_URLS, settings.TURN_URLS, settings.TURN_SECRET = [], ["turn:turn.example.org"], ""
    assert ice_servers("visitor", 0.0) == ()


def test_the_relays_of_a_region_are_one_entry(settings):
    settings.STUN_URLS, settings.TURN_SECRET = [], "secret"
    settings.TURN_URLS = [
        "eu=turn:eu.example.org?transport=udp",
        "us = turn:us.example.org",
        "eu=turns:eu.example.org?transport=tcp",
    ]
    eu, us = ice_servers("visitor", 0.0)
    assert eu.urls == ("turn:eu.example.org?transport=udp", "turns:eu.example.org?transport=tcp")
    assert us.urls == ("turn:us.example.org",)
    assert us.credential == eu.credential


def test_an_address_without_a_region_keeps_its_own_equals_sign():
    words = ["turn:a.example.org?transport=udp", "turns:a.example.org?transport=tcp"]
    assert relays_by_region(words) == {"": words}
