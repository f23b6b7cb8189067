"""Who is let in, and as what."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from robots.agent.media.peers.registry import (
    MAX_HELD_CANDIDATES,
    MAX_HELD_PEERS,
    STAYS_AFTER_DRIVING,
    STAYS_UNVOUCHED,
    Admission,
    HeldCandidates,
    PeerRegistry,
)
from robots.api.messages import Candidate


def test_observers_are_refused_when_the_places_are_taken() -> None:
    roster = PeerRegistry(2)
    assert roster.admit("a", "observer", 0.0).admitted
    assert roster.admit("b", "observer", 0.0).admitted
    assert not roster.admit("c", "observer", 0.0).admitted
    roster.leave("a")
    assert roster.admit("c", "observer", 0.0).admitted


def test_a_second_offer_of_a_connected_peer_needs_no_second_place() -> None:
    roster = PeerRegistry(1)
    roster.admit("a", "observer", 0.0)
    assert roster.admit("a", "observer", 0.0) == Admission(admitted=True)


def test_the_driver_finds_room_and_the_newest_observer_leaves() -> None:
    roster = PeerRegistry(3)
    for peer, role in (("screen", "screen"), ("o1", "observer"), ("o2", "observer")):
        roster.admit(peer, role, 0.0)
    assert roster.admit("driver", "driver", 0.0) == Admission(admitted=True, leaves="o2")
    roster.lease_changed("driver", 0.0)
    assert roster.admit("driver2", "driver", 0.0).leaves == "o1"
    assert roster.admit("driver3", "driver", 0.0).leaves == "driver2", "who holds no lease counts as an observer"
    assert roster.admit("driver4", "driver", 0.0).leaves == "driver3"


def test_a_robot_without_places_still_takes_its_driver() -> None:
    roster = PeerRegistry(0)
    assert roster.admit("a", "driver", 0.0).admitted
    roster.lease_changed("a", 0.0)
    assert roster.admit("b", "driver", 0.0) == Admission(admitted=True, leaves="a")


def test_the_lease_alone_makes_a_driver() -> None:
    roster = PeerRegistry(4)
    roster.admit("a", "driver", 0.0)
    roster.admit("b", "observer", 0.0)
    roster.admit("s", "screen", 0.0)
    assert [roster.role(p) for p in ("a", "b", "s", "unknown")] == ["observer", "observer", "screen", "observer"]
    roster.lease_changed("a", 0.0)
    assert roster.role("a") == "driver"
    roster.lease_changed("b", 0.0)
    assert [roster.role(p) for p in ("a", "b", "s")] == ["observer", "driver", "screen"]
    roster.lease_changed(None, 0.0)
    assert [roster.role(p) for p in ("a", "b")] == ["observer", "observer"]


def test_who_has_driven_stays_only_by_an_offer_of_their_own() -> None:
    roster = PeerRegistry(4)
    roster.admit("a", "driver", 0.0)
    roster.lease_changed("a", 0.0)
    assert roster.unwelcome(1000.0) == {}, "the lease speaks for the driver"
    roster.lease_changed(None, 1000.0)
    assert roster.unwelcome(1000.0 + STAYS_AFTER_DRIVING) == {}, "a lease that came late is there again"
    assert roster.unwelcome(1000.1 + STAYS_AFTER_DRIVING) == {"a": "lease_changed"}
    roster.lease_changed("a", 1002.0)
    assert roster.unwelcome(1100.0) == {}
    roster.lease_changed("b", 1100.0)
    roster.admit("a", "observer", 1101.0)
    assert roster.unwelcome(1101.0 + STAYS_UNVOUCHED) == {}, "it watches now, by a new offer"


@pytest.mark.parametrize("role", ["observer", "screen", "driver"])
def test_who_watches_stays_while_the_server_speaks_for_them(role) -> None:
    roster = PeerRegistry(4)
    roster.admit("a", role, 0.0)
    for minute in range(1, 60):
        assert roster.unwelcome(60.0 * minute) == {}
        roster.vouch("a", 60.0 * minute)
    last = 60.0 * 59
    assert roster.unwelcome(last + STAYS_UNVOUCHED) == {}
    assert roster.unwelcome(last + STAYS_UNVOUCHED + 0.1) == {"a": "not_vouched"}
    roster.vouch("nobody", last)
    roster.leave("a")
    assert roster.unwelcome(last + 1e6) == {}


@given(
    st.lists(
        st.tuples(st.sampled_from(["offer", "leave", "lease"]), st.sampled_from("abcdef"), st.sampled_from(["driver", "observer", "screen"])),
        max_size=60,
    )
)
def test_never_more_than_the_limit_and_never_two_drivers(steps: list[tuple[str, str, str]]) -> None:
    roster, inside = PeerRegistry(3), set()
    for what, peer, role in steps:
        if what == "offer":
            admission = roster.admit(peer, role, 0.0)
            inside -= {admission.leaves}
            inside |= {peer} if admission.admitted else set()
            assert admission.admitted or role != "driver"
        elif what == "leave":
            roster.leave(peer)
            inside.discard(peer)
        else:
            roster.lease_changed(peer, 0.0)
        assert len(inside) <= 3
        assert sum(roster.role(p) == "driver" for p in "abcdef") <= 1


def test_early_candidates_are_kept_for_their_offer_within_bounds() -> None:
    held = HeldCandidates()
    for n in range(MAX_HELD_CANDIDATES + 5):
        held.hold("a", Candidate(candidate=str(n)))
    assert len(held.release("a")) == MAX_HELD_CANDIDATES
    assert held.release("a") == []
    for n in range(MAX_HELD_PEERS + 5):
        held.hold(f"p{n}", Candidate(candidate="x"))
    assert held.release("p0") == []
    assert len(held.release(f"p{MAX_HELD_PEERS}")) == 1
