"""A study's task as a server tells it to a drive page."""

import json
import time

from experiments import task_page
from experiments.shipped import shipped
from robots.agent.world.sites import load_plan
from sessions import wire
from tests.support.fake_robot_page import STEP, FakeRobotPage


def guide(**changes):
    study = shipped()["exploration"]
    plan, _ = load_plan("office")
    told = task_page.guide(study, study.task, [study.condition("giraff_open")], plan, language="en", step_url=STEP)
    return json.loads(json.dumps({**told, **changes}))


def tell(site: FakeRobotPage, cue: str, **fields) -> None:
    site.tell("session/task", wire.Task(session=site.session, stamp=time.time(), cue=cue, **fields))
