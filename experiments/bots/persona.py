"""A bot's persona: seeded traits, a style of driving and opinions, into which effects are
planted.

An opinion on a question is normal with mean 0 and variance 1 over many bots: part of it is the
person's own and the same in all of their answers, the rest belongs to the answer. An effect moves
it by so many standard deviations where all of its circumstances hold; one of size 0 is a planted
null. Bots know no condition: circumstances are what a driver sees (the robot, the assistance in
force, …) and how many times they have driven, `drive`.
"""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.special import ndtr

OWN_SHARE = 0.5  # of the variance of an opinion that is the person's own
LATE_BIRTH, EARLY_BIRTH = 2003, 1950
CHROME = "AppleWebKit/537.36 (KHTML, like Gecko) Chrome/141.0.0.0"
SAFARI = "AppleWebKit/605.1.15 (KHTML, like Gecko) Version/18.3 Safari/605.1.15"
AGENTS = (
    "Mozilla/5.0 (X11; Linux x86_64; rv:140.0) Gecko/20100101 Firefox/140.0",
    f"Mozilla/5.0 (Windows NT 10.0; Win64; x64) {CHROME} Safari/537.36",
    f"Mozilla/5.0 (Macintosh; Intel Mac OS X 10_15_7) {SAFARI}",
    f"Mozilla/5.0 (Linux; Android 14; Pixel 8) {CHROME} Mobile Safari/537.36",
)
MARK = " TelepresenceBot/1.0"
FORM = re.compile(
    r"^(?P<item>[a-z][a-z0-9_]*)(@(?P<where>[a-z_]+=[^:@=,]+(,[a-z_]+=[^:@=,]+)*))?"
    r":(?P<size>[-+]?[0-9]*\.?[0-9]+)$"
)
PACE = "pace"  # the one name of an effect that is no question: how fast the bot drives
DRIVE = "drive"  # the circumstance that is no condition: which of the bot's drives it is, from 1


class EffectError(ValueError):
    """An effect that cannot be read; one sentence."""


@dataclass(frozen=True)
class Effect:
    """`size` standard deviations on a question, or on the `pace` of driving, where each
    circumstance of `where` has its value.
    """

    item: str
    size: float
    where: Mapping[str, str] = field(default_factory=dict)

    def holds(self, circumstances: Mapping[str, str]) -> bool:
        return all(circumstances.get(name) == value for name, value in self.where.items())


def effect(text: str) -> Effect:
    """Return the effect that is written as `question@circumstance=value:size`, such as
    `easy@assist=steer:0.8`; several circumstances have commas between, `easy@assist=steer,drive=2`.
    Raises an EffectError for any other text.
    """
    found = FORM.match(text.strip())
    if found is None:
        raise EffectError(
            f"“{text}” is not an effect: write question:size or "
            "question@circumstance=value:size, such as easy@assist=steer:0.8."
        )
    where = (one.split("=") for one in (found["where"] or "").split(",") if one)
    return Effect(found["item"], float(found["size"]), dict(where))


@dataclass
class Persona:
    """One bot. `explore`, when set, makes it choose the n-th option of every list, so that bots 0,
    1, 2 … open every branch.
    """

    number: int
    seed: int
    effects: Sequence[Effect] = ()
    explore: int | None = None
    _own: float = field(init=False)

    def __post_init__(self) -> None:
        rng = self._rng("self")
        self._own = float(rng.standard_normal())
        self.birth_year = int(rng.integers(EARLY_BIRTH, LATE_BIRTH))
        self.agent = AGENTS[rng.integers(len(AGENTS))] + MARK
        self.method = "touch" if "Mobile" in self.agent else ("keyboard", "mouse")[rng.integers(2)]
        self._pace = min(max(0.85 + 0.1 * float(rng.standard_normal()), 0.6), 1.0)

    def _rng(self, *about: str) -> np.random.Generator:
        """Return the generator for one subject. It does not depend on earlier questions, so that a
        page that is shown twice gets the same answers.
        """
        text = np.frombuffer("\x1f".join(about).encode(), np.uint8).astype(np.uint32)
        words: list[Any] = [self.seed, self.number, text]
        return np.random.default_rng(words)

    def opinion(self, item: str, circumstances: Mapping[str, str]) -> float:
        """Return how much the bot agrees, in standard deviations of all bots. The order of its
        drives matters only to planted effects.
        """
        about = sorted(f"{k}={v}" for k, v in circumstances.items() if k != DRIVE)
        noise = float(self._rng("opinion", item, *about).standard_normal())
        own = math.sqrt(OWN_SHARE) * self._own + math.sqrt(1.0 - OWN_SHARE) * noise
        return own + self._shift(item, circumstances)

    def point(self, item: str, count: int, circumstances: Mapping[str, str]) -> int:
        """Return the chosen one of `count` ordered points: 0 is the lowest. Without effects, all
        are equally likely.
        """
        if self.explore is not None:
            return self.explore % count
        return min(count - 1, int(float(ndtr(self.opinion(item, circumstances))) * count))

    def option(self, item: str, count: int) -> int:
        if self.explore is not None:
            return self.explore % count
        return int(self._rng("option", item).integers(count))

    def number_between(
        self, item: str, low: float, high: float, circumstances: Mapping[str, str]
    ) -> float:
        return low + (high - low) * float(ndtr(self.opinion(item, circumstances)))

    def pace(self, circumstances: Mapping[str, str]) -> float:
        return float(np.clip(self._pace + 0.1 * self._shift(PACE, circumstances), 0.4, 1.0))

    def _shift(self, item: str, circumstances: Mapping[str, str]) -> float:
        effects = (one for one in self.effects if one.item == item and one.holds(circumstances))
        return sum(one.size for one in effects)
