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
    bot = SimpleNamespace(view=view, ending=Ending.COMPLETES, _is_driven=False)
    assert BotDrive._with_pauses(bot, AHEAD) == steers


def test_a_bot_lets_go_where_a_hidden_operator_drives():
    view = View(state=words.state(safety=m.Safety(inhibited=None)))
    bot = SimpleNamespace(view=view, ending=Ending.COMPLETES, _is_driven=True)
    assert BotDrive._with_pauses(bot, AHEAD) == STAND


@pytest.mark.parametrize(
    ("study", "is_driven"),
    [({}, False), ({"controllers": ["touch"]}, False), ({"controllers": []}, True)],
)
def test_a_page_without_controllers_is_that_of_somebody_who_is_driven(study, is_driven):
    config = {"robot": "giraff", "socket": "/", **({"study": study} if study else {})}
    persona = SimpleNamespace(method="keyboard")
    assert BotDrive(None, config, persona, Ending.COMPLETES)._is_driven == is_driven
