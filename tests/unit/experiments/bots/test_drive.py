"""How a bot steers, beside where to."""

from types import SimpleNamespace

import pytest

from experiments.bots.drive import BotDrive
from experiments.bots.endings import Ending
from experiments.bots.steering import STAND, SpeedSetting
from experiments.bots.view import View
from robots.api import messages as m
from tests.support import words

AHEAD = SpeedSetting(0.3, 0.1)


@pytest.mark.parametrize(
    ("inhibited", "steers"), [(None, AHEAD), ("stopped", STAND), ("no_lease", AHEAD)]
)
def test_a_bot_lets_go_where_the_robot_waits_for_that(inhibited, steers):
    view = View(state=words.state(safety=m.Safety(inhibited=inhibited)))
    bot = SimpleNamespace(view=view, ending=Ending.COMPLETES)
    assert BotDrive._with_pauses(bot, AHEAD) == steers
