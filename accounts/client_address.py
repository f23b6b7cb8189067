"""Where a request comes from, as proxies of ours tell it, and for whom it counts."""

import ipaddress
from collections.abc import Iterable

NETWORK_PREFIX = 64  # bits of an IPv6 address: whoever has one has all that begin so


def visitor_address(forwarded: str, address: str, trusted_proxies: Iterable[str]) -> str:
    """Return the address that the nearest untrusted party had: what stands left of it in
    X-Forwarded-For is only a claim.
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


def parsed(address: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address | None:
    """Return an address without its zone, one of IPv4 as such however it is written, or None for
    what is none.
    """
    try:
        found = ipaddress.ip_address(address.partition("%")[0])
    except ValueError:
        return None
    return found.ipv4_mapped or found if isinstance(found, ipaddress.IPv6Address) else found


def counted(address: str) -> str:
    """Return for whom an address counts: one of IPv4 for itself, one of IPv6 for its household;
    what is none stays as it is.
    """
    found = parsed(address)
    if found is None:
        return address
    return (
        str(found)
        if found.version == 4
        else str(ipaddress.ip_network((found, NETWORK_PREFIX), strict=False))
    )
