"""Which peers are admitted, and with which role."""

import pytest
from hypothesis import given, strategies as st

from robots.agent.media.peers.registry import (
    MAX_HELD_CANDIDATES,
    MAX_HELD_PEERS,
    STAYS_AFTER_DRIVING,
    STAYS_UNVOUCHED,
    HeldCandidates,
    PeerAdmission,
    PeerRegistry,
)
from robots.api.messages import Candidate


def test_observers_are_refused_when_the_robot_is_full() -> None:
    registry = PeerRegistry(2)
    assert registry.admit("a", "observer", 0.0).admitted
    assert registry.admit("b", "observer", 0.0).admitted
    assert not registry.admit("c", "observer", 0.0).admitted
    registry.leave("a")
    assert registry.admit("c", "observer", 0.0).admitted


def test_second_offer_of_a_connected_peer_needs_no_second_place() -> None:
    registry = PeerRegistry(1)
    registry.admit("a", "observer", 0.0)
    assert registry.admit("a", "observer", 0.0) == PeerAdmission(admitted=True)


def test_driver_replaces_the_newest_observer() -> None:
    registry = PeerRegistry(3)
    for peer, role in (("screen", "screen"), ("o1", "observer"), ("o2", "observer")):
        registry.admit(peer, role, 0.0)
    assert registry.admit("driver", "driver", 0.0) == PeerAdmission(admitted=True, leaves="o2")
    registry.lease_changed("driver", 0.0)
    assert registry.admit("driver2", "driver", 0.0).leaves == "o1"
    # without the lease, driver2 counts as an observer
    assert registry.admit("driver3", "driver", 0.0).leaves == "driver2"
    assert registry.admit("driver4", "driver", 0.0).leaves == "driver3"


def test_robot_without_places_admits_its_driver() -> None:
    registry = PeerRegistry(0)
    assert registry.admit("a", "driver", 0.0).admitted
    registry.lease_changed("a", 0.0)
    assert registry.admit("b", "driver", 0.0) == PeerAdmission(admitted=True, leaves="a")


def test_only_the_lease_makes_a_driver() -> None:
    registry = PeerRegistry(4)
    registry.admit("a", "driver", 0.0)
    registry.admit("b", "observer", 0.0)
    registry.admit("s", "screen", 0.0)
    roles = lambda *peers: [registry.role(peer) for peer in peers]
    assert roles("a", "b", "s", "unknown") == ["observer", "observer", "screen", "observer"]
    registry.lease_changed("a", 0.0)
    assert registry.role("a") == "driver"
    registry.lease_changed("b", 0.0)
    assert roles("a", "b", "s") == ["observer", "driver", "screen"]
    registry.lease_changed(None, 0.0)
    assert roles("a", "b") == ["observer", "observer"]


def test_former_driver_stays_only_with_a_new_offer() -> None:
    registry = PeerRegistry(4)
    registry.admit("a", "driver", 0.0)
    registry.lease_changed("a", 0.0)
    assert registry.unwelcome(1000.0) == {}, "the driver needs no vouching"
    registry.lease_changed(None, 1000.0)
    assert registry.unwelcome(1000.0 + STAYS_AFTER_DRIVING) == {}, "a late lease may return"
    assert registry.unwelcome(1000.1 + STAYS_AFTER_DRIVING) == {"a": "lease_changed"}
    registry.lease_changed("a", 1002.0)
    assert registry.unwelcome(1100.0) == {}
    registry.lease_changed("b", 1100.0)
    registry.admit("a", "observer", 1101.0)
    assert registry.unwelcome(1101.0 + STAYS_UNVOUCHED) == {}, "it became an observer"


@pytest.mark.parametrize("role", ["observer", "screen", "driver"])
def test_observer_stays_while_the_server_vouches(role) -> None:
    registry = PeerRegistry(4)
    registry.admit("a", role, 0.0)
    for minute in range(1, 60):
        assert registry.unwelcome(60.0 * minute) == {}
        registry.vouch("a", 60.0 * minute)
    last = 60.0 * 59
    assert registry.unwelcome(last + STAYS_UNVOUCHED) == {}
    assert registry.unwelcome(last + STAYS_UNVOUCHED + 0.1) == {"a": "not_vouched"}
    registry.vouch("nobody", last)
    registry.leave("a")
    assert registry.unwelcome(last + 1e6) == {}


@given(
    st.lists(
        st.tuples(
            st.sampled_from(["offer", "leave", "lease"]),
            st.sampled_from("abcdef"),
            st.sampled_from(["driver", "observer", "screen"]),
        ),
        max_size=60,
    )
)
def test_peers_never_exceed_the_limit_and_there_are_never_two_drivers(
    steps: list[tuple[str, str, str]],
) -> None:
    registry, inside = PeerRegistry(3), set()
    for what, peer, role in steps:
        if what == "offer":
            admission = registry.admit(peer, role, 0.0)
            inside -= {admission.leaves}
            inside |= {peer} if admission.admitted else set()
            assert admission.admitted or role != "driver"
        elif what == "leave":
            registry.leave(peer)
            inside.discard(peer)
        else:
            registry.lease_changed(peer, 0.0)
        assert len(inside) <= 3
        assert sum(registry.role(p) == "driver" for p in "abcdef") <= 1


def test_early_candidates_are_held_for_their_offer_within_bounds() -> None:
    held = HeldCandidates()
    for n in range(MAX_HELD_CANDIDATES + 5):
        held.hold("a", Candidate(candidate=str(n)))
    assert len(held.release("a")) == MAX_HELD_CANDIDATES
    assert held.release("a") == []
    for n in range(MAX_HELD_PEERS + 5):
        held.hold(f"p{n}", Candidate(candidate="x"))
    assert held.release("p0") == []
    assert len(held.release(f"p{MAX_HELD_PEERS}")) == 1
