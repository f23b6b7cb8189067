"""Which of the driver's words the robot's displays have shown and spoken. Pure.

Several displays may report different results, late or twice; a better result replaces a worse one.
"""

from collections import OrderedDict

from robots.api.messages import WordsState

KEPT = 200  # words whose fate is remembered, the newest
RANK: dict[WordsState, int] = {"shown": 1, "not_spoken": 2, "spoken": 3}


class Receipts:
    def __init__(self) -> None:
        self._words: OrderedDict[str, tuple[str, WordsState | None]] = OrderedDict()

    def sent(self, action_id: str, session: str) -> None:
        """Remember words that are sent to the displays."""
        self._words[action_id] = (session, None)
        while len(self._words) > KEPT:
            self._words.popitem(last=False)

    def confirm(self, action_id: str, state: WordsState, session: str | None) -> tuple[str, bool]:
        """Take a display's report; return why it is refused ("" when it is not), and whether it is
        news for the driver. Words of any session but the live `session` are refused.
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
