"""Pages whose open state is stored in one batch."""

import asyncio

import pytest
from asgiref.sync import sync_to_async
from django.db import OperationalError

from sessions.consumers import last_seen
from sessions.consumers.last_seen import LastSeenBatcher


@pytest.fixture
def asked(monkeypatch):
    """The sessions of each query; `over` has ended, and `away` makes the database fail."""
    found = []

    def seen(sessions, now):
        found.append(set(sessions))
        if "away" in sessions:
            raise OperationalError("away")
        return sessions - {"over"}

    monkeypatch.setattr(last_seen.store, "seen", seen)

    async def query(question, *arguments):  # no connection is looked after, as none is used
        return await sync_to_async(question)(*arguments)

    monkeypatch.setattr(last_seen, "query", query)
    monkeypatch.setattr(last_seen, "GATHER_SECONDS", 0.05)
    return found


async def test_many_pages_share_one_query_and_each_gets_its_own_answer(asked):
    pages = LastSeenBatcher()
    answers = await asyncio.gather(*(pages.seen(session) for session in ("a", "over", "b")))
    assert answers == [True, False, True]
    assert await pages.seen("a")
    assert asked == [{"a", "over", "b"}, {"a"}]


async def test_a_database_error_reaches_every_page_and_the_next_page_asks_again(asked):
    pages = LastSeenBatcher()
    sent = await asyncio.gather(pages.seen("a"), pages.seen("away"), return_exceptions=True)
    assert [type(one) for one in sent] == [OperationalError, OperationalError]
    assert await pages.seen("a")


async def test_a_page_that_leaves_does_not_cancel_the_batch(asked):
    pages = LastSeenBatcher()
    leaves, stays = (asyncio.create_task(pages.seen(session)) for session in ("a", "b"))
    await asyncio.sleep(0)
    leaves.cancel()
    assert await stays
    assert asked == [{"a", "b"}]


async def test_a_page_that_has_closed_is_not_reported_as_open(asked):
    pages = LastSeenBatcher()
    closes, stays = (asyncio.create_task(pages.seen(session)) for session in ("a", "b"))
    await asyncio.sleep(0)
    await pages.forget("a")
    assert (await closes, await stays) == (False, True)
    assert asked == [{"b"}]


async def test_page_that_closes_waits_for_the_batch_that_names_it(monkeypatch):
    stored, slow = [], asyncio.Event()

    async def query(_store, present, _now):
        await slow.wait()
        stored.append(present)
        return present

    monkeypatch.setattr(last_seen, "GATHER_SECONDS", 0.0)
    monkeypatch.setattr(last_seen, "query", query)
    pages = LastSeenBatcher()
    seen = asyncio.create_task(pages.seen("a"))
    await asyncio.sleep(0.01)
    leaving = asyncio.create_task(pages.forget("a"))
    await asyncio.sleep(0.01)
    assert not leaving.done()
    slow.set()
    await leaving
    assert stored == [{"a"}]
    assert await seen


def test_a_batch_of_a_closed_event_loop_is_not_awaited(asked):
    pages = LastSeenBatcher()

    async def first():
        task = asyncio.create_task(pages.seen("a"))
        await asyncio.sleep(0)
        task.cancel()

    asyncio.run(first())
    assert asyncio.run(asyncio.wait_for(pages.seen("b"), 10))
    assert asked == [{"b"}]
