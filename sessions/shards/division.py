"""Decides from the rows of members and shards what one session manager does about them: pure.

Members occupy slots, and count their beats in their rows. No clocks of two machines are compared:
an observer takes a member for dead when it has seen the same count for SILENT_SECONDS of its own
monotonic clock. A member that is taken for dead loses its slot by one conditional update that names
the count; its shards then have an owner who holds no slot, and their next owners count up the
epochs. So a member that was only slow finds its slot and its shards gone, and every write that
carries an old epoch is refused (sessions/shards/ownership.py).
"""

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass

from sessions.shards.hashing import N_SHARDS, preferred_slot

ALL = range(N_SHARDS)
SILENT_SECONDS = 1.2  # of a count that does not grow, once it has been seen to grow
FIRST_SECONDS = 3.0  # of one that was never seen to grow: a member that is alone beats slowly


@dataclass(frozen=True, slots=True)
class ManagerSlot:
    """The row of a slot. `holder` is the process that occupies it, empty if none; `prepared` are
    the slots by whose division it has subscribed to the broker's topics.
    """

    slot: int
    holder: str
    beats: int
    prepared: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class Holding:
    """The row of a shard: `owner` may do its work under `epoch`."""

    number: int
    owner: str
    epoch: int


@dataclass(slots=True)
class _Seen:
    holder: str
    beats: int
    since: float
    grew: bool = False


class Observer:
    """Which members are silent. All times are seconds of this process's monotonic clock."""

    def __init__(self) -> None:
        self._seen: dict[int, _Seen] = {}

    def see(self, members: Iterable[ManagerSlot], now: float) -> None:
        """Take rows that were read at `now`, or later."""
        for member in members:
            before = self._seen.get(member.slot)
            if before is None or before.holder != member.holder:
                self._seen[member.slot] = _Seen(member.holder, member.beats, now)
            elif before.beats != member.beats:
                before.beats, before.since, before.grew = member.beats, now, True

    def is_silent(self, member: ManagerSlot, now: float) -> bool:
        """Tell whether this holder has not beaten for so long that it is taken for dead."""
        seen = self._seen.get(member.slot)
        if seen is None or (seen.holder, seen.beats) != (member.holder, member.beats):
            return False
        return now - seen.since >= (SILENT_SECONDS if seen.grew else FIRST_SECONDS)

    def is_alive(self, member: ManagerSlot, now: float) -> bool:
        """Tell whether this holder has been seen to beat, and is not silent."""
        seen = self._seen.get(member.slot)
        return seen is not None and seen.grew and not self.is_silent(member, now)


def occupied(members: Iterable[ManagerSlot]) -> dict[int, ManagerSlot]:
    """Return the members whose slot is occupied, by slot."""
    return {member.slot: member for member in members if member.holder}


def claims(
    holdings: Collection[Holding], members: Collection[ManagerSlot], slot: int
) -> frozenset[int]:
    """Return the shards without a living owner that this slot takes.

    A member that has not reached the broker yet takes none as long as another one has.
    """
    taken = occupied(members)
    holders = {member.holder for member in taken.values()}
    slots = [key for key, member in taken.items() if member.prepared] or list(taken)
    orphans = (one.number for one in holdings if one.owner not in holders)
    return frozenset(number for number in orphans if preferred_slot(number, slots) == slot)


def gifts(
    holdings: Collection[Holding], members: Collection[ManagerSlot], holder: str
) -> Mapping[str, frozenset[int]]:
    """Return which of a holder's shards go to whom: to the member that each prefers, as soon as
    that one has subscribed to their topics.
    """
    taken = occupied(members)
    slots = tuple(sorted(taken))
    given: dict[str, set[int]] = {}
    for one in holdings:
        if one.owner == holder and taken:
            heir = taken[preferred_slot(one.number, slots)]
            if heir.holder != holder and heir.prepared == slots:
                given.setdefault(heir.holder, set()).add(one.number)
    return {heir: frozenset(numbers) for heir, numbers in given.items()}
