"""The rows of members and shards in memory: each function changes what the conditional update of
sessions/shards/rows.py with the same name changes, and under the same conditions.
"""

from dataclasses import replace

from sessions.shards.division import ALL, Holding, ManagerSlot


class MemoryRows:
    def __init__(self) -> None:
        self._members: dict[int, ManagerSlot] = {}
        self.shards = {number: Holding(number, "", 0) for number in ALL}

    def members(self) -> list[ManagerSlot]:
        return [self._members[slot] for slot in sorted(self._members)]

    def occupy(self, slot, before, holder, _now) -> bool:
        if self._members.get(slot) != before:
            return False
        beats = before.beats + 1 if before is not None else 1
        self._members[slot] = ManagerSlot(slot, holder, beats)
        return True

    def dismiss(self, member) -> bool:
        if self._members.get(member.slot) != member:
            return False
        self._members[member.slot] = ManagerSlot(member.slot, "", member.beats + 1)
        return True

    def beat(self, slot, holder, beats, _now, report) -> bool:
        there = self._members.get(slot)
        if there is None or there.holder != holder:
            return False
        prepared = tuple(report.get("prepared", ()))
        self._members[slot] = replace(there, beats=beats, prepared=prepared)
        return True

    def give_back(self, holder) -> None:
        for slot, member in self._members.items():
            if member.holder == holder:
                self._members[slot] = ManagerSlot(slot, "", member.beats)

    def last_alive(self) -> None:
        return None

    def holdings(self) -> list[Holding]:
        return list(self.shards.values())

    def take_over(self, numbers, owners, holder) -> None:
        self._change(holder, (n for n in numbers if self.shards[n].owner in owners))

    def hand_over(self, numbers, giver, heir) -> None:
        self._change(heir, (n for n in numbers if self.shards[n].owner == giver))

    def _change(self, owner, numbers) -> None:
        for number in list(numbers):
            self.shards[number] = Holding(number, owner, self.shards[number].epoch + 1)
