"""How bots come into a study."""

from experiments.bots.endings import Ending
from experiments.definition.shipped import shipped
from telepresence_site.rehearsal.play import accesses_of

STUDY = shipped()["exploration"]


def test_bots_come_by_each_way_as_often_as_there_are_conditions_for_it_by_turns():
    assert accesses_of(STUDY, [Ending.COMPLETES] * 5) == [
        "open",
        "invitation",
        "open",
        "invitation",
        "open",
    ]


def test_bots_with_an_ending_about_the_photo_use_a_robot_with_photos():
    endings = [Ending.COMPLETES, Ending.SKIPS_PHOTO, Ending.TAKES_PHOTO_AGAIN, Ending.COMPLETES]
    assert accesses_of(STUDY, endings) == ["open", "open", "open", "invitation"]
