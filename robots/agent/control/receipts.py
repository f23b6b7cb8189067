"""What became of the driver's words at the robot's displays: decisions only.

A display says that it has shown them, and whether it has read them aloud. Several displays may say
different things, late or twice: what is known only grows.
"""

from collections import OrderedDict

from robots.api.messages import WordsState

KEPT = 200  # words whose fate is remembered, the newest
RANK: dict[WordsState, int] = {"shown": 1, "not_spoken": 2, "spoken": 3}


class Receipts:
    """The newest words of drivers, and how far each came."""

    def __init__(self) -> None:
        self._words: OrderedDict[str, tuple[str, WordsState | None]] = OrderedDict()

    def said(self, action_id: str, session: str) -> None:
        """Remember words that go out to the displays."""
        self._words[action_id] = (session, None)
        while len(self._words) > KEPT:
            self._words.popitem(last=False)

    def confirm(self, action_id: str, state: WordsState, session: str | None) -> tuple[str, bool]:
        """Take what a display says of words; return in one word why that is refused, "" when it is
        not, and whether the driver has something new to hear.

        Words of a session that is over are nobody's: `session` is the one that drives, or None.
        """
        of, known = self._words.get(action_id, ("", None))
        if not of or of != session:
            return "unknown_words", False
        is_news = known is None or RANK[state] > RANK[known]
        if is_news:
            self._words[action_id] = (of, state)
        return "", is_news

    def of(self, action_id: str) -> tuple[str, WordsState] | None:
        """Return (session, state) of words that a display has confirmed, or None."""
        session, state = self._words.get(action_id, ("", None))
        return (session, state) if state is not None else None
