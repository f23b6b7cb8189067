"""For whom a request counts."""

import pytest

from accounts.client_address import counted, visitor_address


@pytest.mark.parametrize(
    ("address", "who"),
    [
        ("198.51.100.7", "198.51.100.7"),
        ("2001:db8:1:2:3:4:5:6", "2001:db8:1:2::/64"),
        ("2001:db8:1:2::9", "2001:db8:1:2::/64"),
        ("2001:db8:1:3::9", "2001:db8:1:3::/64"),
        ("fe80::1%eth0", "fe80::/64"),
        ("::ffff:198.51.100.7", "198.51.100.7"),
        ("nonsense", "nonsense"),
        ("", ""),
    ],
)
def test_an_address_counts_for_itself_and_one_of_ipv6_for_all_that_its_household_has(
    address: str, who: str
) -> None:
    assert counted(address) == who


def test_a_claim_of_an_address_counts_as_far_as_our_own_proxies_tell_it() -> None:
    proxies = ["10.0.0.0/8", "2001:db8::1"]
    assert (
        visitor_address("6.6.6.6, 203.0.113.9, 10.0.0.2", "2001:db8::1", proxies) == "203.0.113.9"
    )
    assert visitor_address("6.6.6.6", "198.51.100.4", proxies) == "198.51.100.4"
    assert visitor_address(" , ", "10.0.0.2", proxies) == "10.0.0.2"
