"""Which shard a robot belongs to, and which session manager a shard prefers: pure.

Rendezvous hashing (Thaler and Ravishankar, 1998): each shard prefers the slot with the highest hash
of the pair. A slot that joins takes its share from the others and nothing else moves; when a slot
leaves, its shards alone move.
"""

import functools
import hashlib
from collections.abc import Collection, Iterable

N_SHARDS = 64
SITE_SHARD = 0  # its owner does the work that belongs to the whole site


@functools.lru_cache(maxsize=65536)
def shard_of(robot: str, n_shards: int = N_SHARDS) -> int:
    """Return the shard of a robot, by the name in its topics; the same in every process."""
    return _hash(f"robot:{robot}") % n_shards


@functools.lru_cache(maxsize=65536)
def _weight(shard: int, slot: int) -> int:
    return _hash(f"shard:{shard}:slot:{slot}")


def preferred_slot(shard: int, slots: Collection[int]) -> int:
    """Return the slot that a shard belongs to while exactly these slots are taken; at least one."""
    return max(slots, key=lambda slot: (_weight(shard, slot), slot))


def share_of(slot: int, slots: Collection[int], shards: Iterable[int]) -> frozenset[int]:
    """Return those of `shards` that prefer this slot."""
    return frozenset(shard for shard in shards if preferred_slot(shard, slots) == slot)


def _hash(text: str) -> int:
    return int.from_bytes(hashlib.blake2b(text.encode(), digest_size=8).digest(), "big")
