"""The address that a request comes from, and the key that it is counted by."""

import ipaddress
from collections.abc import Iterable

NETWORK_PREFIX = 64  # bits of an IPv6 address: one customer has all addresses with this prefix


def visitor_address(forwarded: str, address: str, trusted_proxies: Iterable[str]) -> str:
    """Return the address of the nearest untrusted sender; those left of it in X-Forwarded-For are
    only its claim.
    """
    networks = [ipaddress.ip_network(proxy, strict=False) for proxy in trusted_proxies]
    current = address
    for hop in reversed([hop.strip() for hop in forwarded.split(",") if hop.strip()]):
        if not _within(current, networks):
            break
        current = hop
    return current


def _within(address: str, networks: list[ipaddress.IPv4Network | ipaddress.IPv6Network]) -> bool:
    try:
        parsed = ipaddress.ip_address(address)
    except ValueError:
        return False
    return any(parsed in network for network in networks)


def parse_address(address: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address | None:
    """Return an address without its zone, an IPv4-mapped one as IPv4; None for any other text."""
    try:
        found = ipaddress.ip_address(address.partition("%")[0])
    except ValueError:
        return None
    return found.ipv4_mapped or found if isinstance(found, ipaddress.IPv6Address) else found


def counted(address: str) -> str:
    """Return an IPv4 address, the /64 prefix of an IPv6 address, or any other text unchanged."""
    found = parse_address(address)
    if found is None:
        return address
    if found.version == 4:
        return str(found)
    return str(ipaddress.ip_network((found, NETWORK_PREFIX), strict=False))
