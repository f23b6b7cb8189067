"""News of actions wait in order, and never without bound."""

import pytest

from robots.agent.adapters.common.progress_queue import MOST, ProgressQueue
from robots.agent.robot_interface import ActionProgress, AdapterError


async def test_unread_progress_is_bounded():
    news = ProgressQueue()
    for number in range(10_000):
        news.put(ActionProgress("a1", "RUNNING", result={"number": float(number)}))
    news.put(ActionProgress("a1", "FINISHED"))
    assert (await news.get()).result == {"number": 9999.0}
    assert (await news.get()).status == "FINISHED"
    for number in range(10_000):
        news.put(ActionProgress(f"a{number}", "RUNNING"))
    left = [(await news.get()).action_id for _ in range(MOST)]
    assert left == [f"a{number}" for number in range(10_000 - MOST, 10_000)]


async def test_an_error_is_raised_after_earlier_progress():
    news = ProgressQueue()
    news.put(ActionProgress("a1", "RUNNING"))
    news.put(AdapterError("gone"))
    assert (await news.get()).action_id == "a1"
    with pytest.raises(AdapterError, match="gone"):
        await news.get()
