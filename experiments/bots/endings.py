"""Endings of a bot's participation: as intended, and as people leave."""

from collections.abc import Sequence
from enum import StrEnum

import numpy as np


class Ending(StrEnum):
    """What a bot does deliberately; otherwise it follows its instructions."""

    COMPLETES = "completes"
    REFUSES = "refuses_consent"
    WITHDRAWS = "withdraws"  # when asked the last questions
    LEAVES_QUEUE = "leaves_the_queue"
    LEAVES_AT_DOCK = "leaves_at_the_dock"
    LEAVES_MIDWAY = "leaves_midway"
    CLOSES_PAGE = "closes_the_page"
    LOSES_NETWORK = "loses_the_network"
    LETS_TIME_RUN_OUT = "lets_the_time_run_out"
    SKIPS_PHOTO = "skips_the_photo"
    STOPS_ANSWERING = "stops_answering"
    COMES_AGAIN = "comes_again"
    LEAVES_READING = "leaves_while_reading"
    # as behind a firewall: nothing that the page sends arrives
    GETS_NO_CONNECTION = "gets_no_connection"
    STAYS_AWAY = "stays_away"  # longer than the grace period
    RELOADS_PAGE = "reloads_the_page"
    OPENS_SECOND_PAGE = "opens_a_second_page"
    PRESSES_STOP = "presses_stop"
    DOCKS_EARLY = "docks_early"
    TAKES_PHOTO_AGAIN = "takes_the_photo_again"
    NEVER_MOVES = "never_moves"  # sees the video, and leaves
    TAKES_ROBOT_AGAIN = "takes_the_robot_again"  # leaves before the video, then drives


EVERY = tuple(Ending)
ABOUT_PHOTO = frozenset({Ending.SKIPS_PHOTO, Ending.TAKES_PHOTO_AGAIN})
LEAVES_AT_ONCE = frozenset({Ending.LEAVES_QUEUE, Ending.LEAVES_AT_DOCK, Ending.TAKES_ROBOT_AGAIN})
# bots that do not drive after the first attempt
GIVES_UP = frozenset(
    {Ending.LEAVES_QUEUE, Ending.LEAVES_AT_DOCK, Ending.GETS_NO_CONNECTION, Ending.NEVER_MOVES}
)
# About as the paper's participants: nine in ten complete the task.
USUAL: dict[Ending, float] = {
    Ending.COMPLETES: 0.72,
    Ending.SKIPS_PHOTO: 0.06,
    Ending.COMES_AGAIN: 0.05,
    Ending.LOSES_NETWORK: 0.04,
    Ending.LEAVES_MIDWAY: 0.03,
    Ending.CLOSES_PAGE: 0.02,
    Ending.LETS_TIME_RUN_OUT: 0.02,
    Ending.LEAVES_AT_DOCK: 0.02,
    Ending.STOPS_ANSWERING: 0.02,
    Ending.REFUSES: 0.01,
    Ending.WITHDRAWS: 0.01,
}


def draw(count: int, rng: np.random.Generator) -> list[Ending]:
    """Return the endings of `count` bots, in the shares of people."""
    names, shares = list(USUAL), np.array(list(USUAL.values()))
    return [names[index] for index in rng.choice(len(names), size=count, p=shares / shares.sum())]


def in_turn(count: int, chosen: Sequence[Ending] = EVERY) -> list[Ending]:
    """Return the endings of `count` bots, each a different one as long as there are some left."""
    return [chosen[index % len(chosen)] for index in range(count)]
