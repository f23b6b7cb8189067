"""How a bot steers, beside where to."""

from types import SimpleNamespace

import pytest

from experiments.bots.drive import BotDrive
from experiments.bots.driver import STAND, SpeedSetting
from experiments.bots.endings import Ending
from experiments.bots.persona import Effect, Persona
from experiments.bots.view import View
from robots.api import messages as m, picture
from sessions import protocol
from tests.support import words

AHEAD = SpeedSetting(0.3, 0.1)


@pytest.mark.parametrize(
    ("inhibited", "steers"), [(None, AHEAD), ("stopped", STAND), ("no_lease", AHEAD)]
)
def test_bot_releases_the_controller_while_the_robot_is_stopped(inhibited, steers):
    view = View(state=words.state(safety=m.Safety(inhibited=inhibited)))
    bot = SimpleNamespace(view=view, ending=Ending.COMPLETES, _is_driven=False)
    assert BotDrive._with_pauses(bot, AHEAD) == steers


def test_bot_does_not_steer_where_a_hidden_operator_drives():
    view = View(state=words.state(safety=m.Safety(inhibited=None)))
    bot = SimpleNamespace(view=view, ending=Ending.COMPLETES, _is_driven=True)
    assert BotDrive._with_pauses(bot, AHEAD) == STAND


@pytest.mark.parametrize(
    ("study", "is_driven"),
    [({}, False), ({"controllers": ["touch"]}, False), ({"controllers": []}, True)],
)
def test_page_with_an_empty_list_of_controllers_has_a_hidden_operator(study, is_driven):
    config = {"robot": "giraff", "socket": "/", **({"study": study} if study else {})}
    persona = SimpleNamespace(method="keyboard")
    assert BotDrive(None, config, persona, Ending.COMPLETES)._is_driven == is_driven


def bot_on(page, view, number=1, *effects):
    """A bot whose page has this configuration of the study, with a view."""
    config = {"robot": "giraff", "socket": "/ws/", "study": page, "factsheet": {"series": "giraff"}}
    bot = BotDrive(None, config, Persona(1, 7, effects), Ending.COMPLETES, number=number)
    bot.cockpit.view = view
    return bot


def test_first_condition_is_read_from_the_grant_as_the_page_is_older():
    granted = View()
    terms = protocol.GrantedTerms(assist="steer", interface="novice")
    granted._take("", protocol.Granted(session="s1", epoch=1, peer="p1", terms=terms), 0.0)
    bot = bot_on({"assist": None, "interface": None}, granted, 3)
    assert bot._circumstances() == {
        "robot": "giraff",
        "assist": "steer",
        "interface": "novice",
        "drive": "3",
    }


def test_effect_of_a_page_on_pace_applies_from_the_first_drive_on():
    slow = Effect("pace", -2.0, {"interface": "novice"})
    bot = bot_on({}, View(), 1, slow)
    before = bot._fastest()
    bot.view.interface = "novice"
    assert bot._fastest().linear < before.linear


def test_age_of_images_is_what_they_reach_before_the_next_one_arrives():
    view = View()
    view._take(picture.SUFFIX, (10.0, b""), 10.2)
    assert view.image_age is None
    view._take(picture.SUFFIX, (10.3, b""), 10.5)
    assert view.image_age == pytest.approx(0.5)
