"""Which shard a robot has, and which session manager a shard prefers."""

from hypothesis import given, strategies as st

from sessions.shards.hashing import N_SHARDS, preferred_slot, shard_of, share_of

SLOTS = st.sets(st.integers(0, 30), min_size=1, max_size=8)
SHARDS = range(N_SHARDS)


def test_a_robots_shard_never_changes():
    assert [shard_of(name) for name in ("giraff", "rhodon", "attic")] == [35, 1, 39]


def test_robots_spread_over_all_shards():
    found = [shard_of(f"robot-{number}") for number in range(6400)]
    counts = [found.count(shard) for shard in SHARDS]
    assert min(counts) > 60
    assert max(counts) < 150


@given(SLOTS)
def test_every_shard_prefers_exactly_one_slot(slots):
    shares = [share_of(slot, slots, SHARDS) for slot in slots]
    assert sorted(shard for share in shares for shard in share) == list(SHARDS)


@given(SLOTS, st.integers(31, 40))
def test_a_slot_that_joins_takes_its_share_and_nothing_else_moves(slots, fresh):
    for shard in SHARDS:
        before, after = preferred_slot(shard, slots), preferred_slot(shard, {*slots, fresh})
        assert after in {before, fresh}


@given(SLOTS, st.data())
def test_a_slot_that_leaves_gives_its_share_and_nothing_else_moves(slots, data):
    left = data.draw(st.sampled_from(sorted(slots)))
    for shard in SHARDS:
        before = preferred_slot(shard, slots)
        if before != left:
            assert preferred_slot(shard, slots - {left}) == before


def test_a_few_slots_share_the_work_about_evenly():
    for n in (2, 3, 4):
        shares = [len(share_of(slot, range(n), SHARDS)) for slot in range(n)]
        assert min(shares) >= N_SHARDS / n / 2, shares
