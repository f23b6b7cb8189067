"""The raised hands and questions of one drive's audience, in one web process: pure.

Every web process that has pages at a robot has a board of its own and sends its changes to the
others (`update`, `merge`). A hand belongs to the process of its page, which sends all of its hands
each time, so that those of a dead process go down. A question belongs to all processes; of two
copies the one with more changes counts. A board with another digest receives all questions. Nothing
is stored. A board without a session is closed.
"""

import unicodedata
import zlib
from typing import get_args

import msgspec

from sessions.protocol import AudienceQuestion, AudienceState, QuestionState

QUESTION_PAUSE = 10.0  # s between two questions of one person
MAX_OWN = 3  # waiting questions of one person
MAX_WAITING = 50  # more than a driver can answer
MAX_QUESTIONS = 300  # of one drive
MAX_NAMES = 30
OWN_SHOWN = 5
HAND_SECONDS = 15.0  # after which the hands of a process without updates go down
ORDER = get_args(QuestionState)
# UAX 9: embeddings, overrides and isolates, which change the direction of the text around them
BIDI_CONTROLS = {"LRE", "RLE", "LRO", "RLO", "PDF", "LRI", "RLI", "FSI", "PDI"}


class RaisedHand(msgspec.Struct, frozen=True):
    """A raised hand; `user` is the key of the account, `stamp` Unix seconds."""

    id: str
    user: str
    who: str
    stamp: float


class Asked(msgspec.Struct, frozen=True):
    """A question; `version` counts its changes."""

    id: str
    user: str
    who: str
    text: str
    stamp: float
    state: QuestionState = "waiting"
    version: int = 1


class BoardUpdate(msgspec.Struct, frozen=True):
    """The changes of a web process: all hands of its pages, the ids of lowered hands, new and
    changed questions, and the digest of all of its questions.
    """

    process: str
    session: str
    hands: tuple[RaisedHand, ...]
    down: tuple[str, ...]
    questions: tuple[Asked, ...]
    digest: int


def sanitize(text: str) -> str:
    """Return a question on one line, without control characters; empty if not visible."""
    line = "".join(
        character
        for character in " ".join(text.split())
        if unicodedata.category(character) != "Cc"
        and unicodedata.bidirectional(character) not in BIDI_CONTROLS
    )
    return line if any(unicodedata.category(each)[0] not in "CZM" for each in line) else ""


class Board:
    """The audience as `process` knows it. `version` grows with every change."""

    def __init__(self, process: str) -> None:
        self.process = process
        self.version = 0
        self.begin(None)

    def begin(self, session: str | None) -> None:
        """Start again, for this session."""
        self.session = session
        self._questions: dict[str, Asked] = {}
        self._own: dict[object, RaisedHand] = {}  # by the page
        # by process, with the time of its update
        self._others: dict[str, tuple[tuple[RaisedHand, ...], float]] = {}
        self._news: set[str] = set()
        self._down: set[str] = set()
        self._change()

    def _change(self) -> None:
        self.version += 1
        others = (hand for hands, _ in self._others.values() for hand in hands)
        by_user = {hand.user: hand for hand in (*others, *self._own.values())}
        self.hands = sorted(by_user.values(), key=lambda hand: (hand.stamp, hand.id))
        self._raised = frozenset(by_user)
        self.questions = sorted(self._questions.values(), key=lambda one: (one.stamp, one.id))
        self._answering = [one for one in self.questions if one.state == "answering"]
        self._by_user: dict[str, list[Asked]] = {}
        for one in self.questions:
            self._by_user.setdefault(one.user, []).append(one)

    # --- requests of pages; each returns the code of its refusal, or nothing
    # -----------------------

    def raise_hand(self, page: object, hand: RaisedHand) -> str:
        """Raise a person's hand. A hand that is up keeps its place, but now belongs to this page:
        the earlier page, or its web process, may be dead without our knowing.
        """
        if self.session is None:
            return "closed"
        raised = next((one for one in self.hands if one.user == hand.user), hand)
        if self._own.get(page) != raised:
            others = {key: one for key, one in self._own.items() if one.user != hand.user}
            self._own = {**others, page: raised}
            self._change()
        return ""

    def lower_hand(self, user: str) -> str:
        """Take down a person's hand, also if another page raised it."""
        return self._lower({hand.id for hand in self.hands if hand.user == user})

    def lower_all(self) -> str:
        """Take down all hands."""
        return self._lower({hand.id for hand in self.hands})

    def leave(self, page: object) -> None:
        """Take down the hand of a page that stops watching."""
        if page in self._own:
            del self._own[page]
            self._change()

    def _lower(self, down: set[str]) -> str:
        if down:
            self._down |= down
            self._drop(down)
            self._change()
        return ""

    def _drop(self, down: set[str]) -> None:
        self._own = {page: hand for page, hand in self._own.items() if hand.id not in down}
        self._others = {
            process: (tuple(hand for hand in hands if hand.id not in down), at)
            for process, (hands, at) in self._others.items()
        }

    def ask(self, question: Asked) -> str:
        """Add a question at the end."""
        if self.session is None:
            return "closed"
        if not question.text:
            return "empty"
        mine = self._by_user.get(question.user, [])
        if mine and question.stamp - mine[-1].stamp < QUESTION_PAUSE:
            return "rate"
        if sum(one.state == "waiting" for one in mine) >= MAX_OWN:
            return "too_many"
        waiting = sum(one.state == "waiting" for one in self.questions)
        if waiting >= MAX_WAITING or len(self.questions) >= MAX_QUESTIONS:
            return "full"
        self._put(question)
        self._change()
        return ""

    def mark(self, key: str, state: QuestionState) -> str:
        """Set the state of a question; only one at a time is being answered."""
        question = self._questions.get(key)
        if question is None:
            return "unknown"
        if state == "answering":
            for one in self._answering:
                self._put(_marked(one, "answered"))
        self._put(_marked(question, state))
        self._change()
        return ""

    def _put(self, question: Asked) -> None:
        self._questions[question.id] = question
        self._news.add(question.id)

    # --- between web processes --------------------------------------------------------------------

    @property
    def digest(self) -> int:
        """A number that differs from that of a board with other questions."""
        lines = (f"{one.id} {one.version} {one.state}" for one in self.questions)
        return zlib.crc32("\n".join(lines).encode())

    def update(self) -> BoardUpdate | None:
        """Return the changes for the other processes; None while the board is closed."""
        if self.session is None:
            return None
        news, self._news = self._news, set()
        down, self._down = self._down, set()
        return BoardUpdate(
            self.process,
            self.session,
            tuple(self._own.values()),
            tuple(down),
            tuple(one for one in self.questions if one.id in news),
            self.digest,
        )

    def merge(self, update: BoardUpdate, now: float) -> bool:
        """Take an update at `now`, monotonic seconds; True when its process lacks questions."""
        if update.process == self.process or update.session != self.session:
            return False
        before, _ = self._others.get(update.process, ((), 0.0))
        self._others[update.process] = (update.hands, now)
        self._drop({*update.down, *self._down})
        newer = [one for one in update.questions if self._is_news(one)]
        self._questions.update({one.id: one for one in newer})
        if newer or update.down or before != self._others[update.process][0]:
            self._change()
        if update.digest == self.digest:
            return False
        self._news |= self._questions.keys()
        return True

    def _is_news(self, question: Asked) -> bool:
        known = self._questions.get(question.id)
        return known is None or _age(question) > _age(known)

    def expire(self, now: float) -> None:
        """Take down the hands of processes that have sent no update for HAND_SECONDS."""
        kept = {key: one for key, one in self._others.items() if now - one[1] < HAND_SECONDS}
        if len(kept) < len(self._others):
            self._others = kept
            self._change()

    # --- views of pages ---------------------------------------------------------------------------

    def view(self, user: str, *, moderates: bool = False) -> AudienceState:
        """Return the view of a page: for all, the question that is being answered, without a name,
        and their own ones; for moderators, also the hands and all waiting questions.
        """
        if self.session is None:
            return AudienceState()
        shown = [one for one in self.questions if one.state == "waiting"] if moderates else []
        own = self._by_user.get(user, [])[-OWN_SHOWN:]
        found = {one.id: one for one in (*self._answering, *shown, *own)}
        questions = sorted(found.values(), key=lambda one: (one.stamp, one.id))
        return AudienceState(
            open=True,
            moderates=moderates,
            raised=user in self._raised,
            hands=len(self.hands) if moderates else 0,
            names=tuple(hand.who for hand in self.hands[:MAX_NAMES]) if moderates else (),
            questions=tuple(_question(one, user, named=moderates) for one in questions),
        )


def _marked(question: Asked, state: QuestionState) -> Asked:
    return msgspec.structs.replace(question, state=state, version=question.version + 1)


def _age(question: Asked) -> tuple[int, int]:
    return question.version, ORDER.index(question.state)


def _question(one: Asked, user: str, *, named: bool) -> AudienceQuestion:
    return AudienceQuestion(
        id=one.id,
        text=one.text,
        state=one.state,
        who=one.who if named else "",
        own=one.user == user,
    )
