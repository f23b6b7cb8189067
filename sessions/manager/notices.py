"""What apps above this one have pages told about a session, waiting for the session manager's next
look.

Receivers of the session manager's signals call `publish`, in its own process; nobody else listens
here.
"""

from collections import deque
from collections.abc import Iterator
from typing import Any

from robots.api import codec, topics
from robots.api.messages import ServerNews

MOST = 10_000
_waiting: deque[ServerNews] = deque(maxlen=MOST)


def publish(session: str, data: dict[str, Any], stamp: float) -> None:
    """Tell the page that drives in a session how far its task is: the fields of
    sessions.protocol.Task; `stamp` in Unix seconds.
    """
    _waiting.append(ServerNews(type="task", stamp=stamp, session=session, data=data))


def are_waiting() -> bool:
    """Tell whether there is anything to publish."""
    return bool(_waiting)


def drain() -> Iterator[tuple[str, bytes]]:
    """Yield (topic, payload) of what waits, and forget it."""
    while _waiting:
        news = _waiting.popleft()
        yield topics.session_news(news.session), codec.encode(news)
