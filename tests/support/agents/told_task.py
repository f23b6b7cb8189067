"""A study's task as a server tells it to a drive page."""

import json
import time

from experiments.definition.shipped import shipped
from experiments.participation import drive_config
from robots.world.sites import load_plan
from sessions import protocol
from tests.support.browsers.fake_robot_page import STEP, FakeRobotPage


def guide(**changes):
    study = shipped()["exploration"]
    plan, _ = load_plan("office")
    told = drive_config.guide(
        study, study.task, [study.condition("giraff_open")], plan, language="en", step_url=STEP
    )
    return json.loads(json.dumps({**told, **changes}))


def tell(site: FakeRobotPage, cue: str, **fields) -> None:
    site.tell(
        "session/task", protocol.Task(session=site.session, stamp=time.time(), cue=cue, **fields)
    )
