"""A whole system for bots alone, in a folder of its own: database, broker, session manager, web
server, one simulated robot of each kind.

Nothing in it touches the site that it was made from: a study goes in as a file, and what was found
comes out as one. It is run by processes that may keep a quick pace (experiments/bots/pace.py),
which the site's own processes must never do.
"""

import copy
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from django.conf import settings
from django.core import serializers
from django.core.management import call_command
from django.utils import timezone

from accounts.models import User
from experiments.definition.schema import StudyDefinition
from experiments.models import Study
from robots.api.credentials_file import ENVIRONMENT
from robots.enrol import credentials
from robots.floorplans import store_floor_plan
from robots.models import FloorPlan, Robot, RobotPresence
from robots.world.sites import shipped_sites
from sessions.models import ManagerBeat
from surveys.models import Questionnaire as QuestionnaireRow
from telepresence_site.children import Child, Children, DemoPart, StartFailed
from telepresence_site.demo.ports import LOOPBACK, answers, free_port, listening
from telepresence_site.demo.seed import OFFICE
from telepresence_site.serving import APPLICATION, DAPHNE

STUDY_FILE = "study.json"
START_SECONDS = 600.0  # for each part: whoever rehearses may have other work for the computer
FPS = "6"  # of the cameras: bots take four pictures a second, and drawing them is what costs most
LEFT_BEHIND = (
    "DATABASE_URL",
    "REDIS_URL",
    "MQTT_URL",
    "MQTT_PUBLIC_URL",
    "TURN_URLS",
    "TURN_SECRET",
    "DEMO_TOKEN",
    "ALLOWED_HOSTS",
    "TRUSTED_PROXIES",
)


def pack(row: Study, folder: Path) -> None:
    """Write a study, its questionnaires and the plans of its sites into a folder."""
    definition = row.as_definition()
    asked = {(step.questionnaire, step.version) for step in definition.asking}
    questionnaires = [
        one for one in QuestionnaireRow.objects.all() if (one.slug, one.version) in asked
    ]
    plans = FloorPlan.objects.filter(
        name__in={condition.site for condition in definition.conditions}
    )
    alone = copy.copy(row)
    alone.published_by = None  # who did it is nobody in there
    folder.mkdir(parents=True, exist_ok=True)
    (folder / STUDY_FILE).write_text(
        serializers.serialize("json", [*plans, *questionnaires, alone]), encoding="utf-8"
    )


def environment(folder: Path, given: dict[str, str]) -> dict[str, str]:
    """Return the environment of the sandbox's processes: nothing leads out of its folder, nor is
    what a robot's agent is told here for its robots.
    """
    kept = {
        name: value
        for name, value in given.items()
        if name not in LEFT_BEHIND and not name.startswith(ENVIRONMENT)
    }
    ours = {
        "VAR_DIR": str(folder),
        "HTTP_ONLY": "1",
        "PLAIN_STATIC": "1",
        "PYTHONUNBUFFERED": "1",
        "SIGNUP_OPEN": "1",
        "EMAIL_VERIFICATION": "none",
        "MQTT_URL": f"mqtt://{LOOPBACK}:{free_port()}",
        "ALLOWED_HOSTS": LOOPBACK,
        "OPENBLAS_NUM_THREADS": "1",
        "OMP_NUM_THREADS": "1",
    }
    return {**kept, **ours}


def unpack() -> Study:
    """Make the sandbox's database, in the process that runs it, and return the study, which is a
    draft in it.
    """
    call_command("migrate", verbosity=0)
    for loaded in serializers.deserialize(
        "json", (settings.VAR_DIR / STUDY_FILE).read_text(encoding="utf-8")
    ):
        loaded.save()
    Study.objects.update(status=Study.Status.DRAFT, opening_hours=[])
    row = Study.objects.get()
    _make_robots(row.as_definition())
    return row


def _make_robots(definition: StudyDefinition) -> None:
    owner = User.objects.create(username="sandbox", is_staff=True, is_superuser=True)
    for name, (series, site) in _robots(definition).items():
        plan = FloorPlan.objects.filter(name=site).first() or store_floor_plan(OFFICE.parent / site)
        robot = Robot.objects.create(
            name=name,
            title=f"{series} at {site}",
            access=Robot.Access.OPEN,
            owner=owner,
            floor_plan=plan,
        )
        kept = credentials.make_credentials(robot, timezone.now())
        credentials.keep_credentials(
            kept, settings.CREDENTIALS_DIR / f"{name}.toml", mqtt_url=settings.MQTT_URL
        )


def _robots(definition: StudyDefinition) -> dict[str, tuple[str, str]]:
    """Return series and site of each robot by its name: the series, with a number where there are
    several (a site's name may be none for a robot).
    """
    pairs = list(
        dict.fromkeys((condition.robot, condition.site) for condition in definition.conditions)
    )
    series = [name for name, _site in pairs]
    return {
        (name if series.count(name) == 1 else f"{name}-{number}"): (name, site)
        for number, (name, site) in enumerate(pairs, 1)
    }


@contextmanager
def running(definition: StudyDefinition, sites: Path) -> Iterator[str]:
    """Run the sandbox's servers and robots, and yield where its site is; everything is ended
    afterwards.

    Args:
        definition: the study.
        sites: where the plans of sites that do not come with the project are kept, as simulators
            take them.

    Raises:
        telepresence_site.children.StartFailed: one of them did not come up, or ended
        meanwhile; one sentence.
    """
    children = Children(settings.VAR_DIR / "log", {**os.environ})
    try:
        yield _start(children, definition, sites)
        gone = children.ended()
        if gone is not None:  # what bots met after that says nothing of the study
            raise StartFailed(
                f"The {gone.name} ended meanwhile ({gone.process.returncode}): {gone.last_line()}"
                f" (its log: {gone.log})"
            )
    finally:
        children.stop()


def _start(children: Children, definition: StudyDefinition, sites: Path) -> str:
    manage = str(settings.BASE_DIR / "manage.py")
    mqtt_port, web_port = int(settings.MQTT_URL.rpartition(":")[2]), free_port()
    site = f"http://{LOOPBACK}:{web_port}"
    parts = [
        DemoPart(
            "broker",
            [manage, "run_broker", "--host", LOOPBACK, "--port", str(mqtt_port)],
            lambda _child: listening(mqtt_port),
        ),
        DemoPart(
            "session manager",
            [manage, "run_session_manager"],
            lambda _child: ManagerBeat.objects.exists(),
        ),
        DemoPart(
            "web server",
            [*DAPHNE, "-b", LOOPBACK, "-p", str(web_port), APPLICATION],
            lambda _child: answers(site),
        ),
    ]
    for name, (series, plan) in _robots(definition).items():
        where = plan if plan in shipped_sites() else str(sites / plan)
        options = [f"--option={key}={value}" for key, value in (("plan", where), ("fps", FPS))]
        parts.append(
            DemoPart(
                f"simulated {name}",
                [manage, "run_robot", name, "--profile", series, *options],
                _online(name),
            )
        )
    children.start_together(parts, within=START_SECONDS)
    return site


def _online(name: str) -> Callable[[Child], bool]:
    return lambda _child: (
        RobotPresence.objects.filter(robot__name=name, connection="ONLINE")
        .exclude(factsheet=None)
        .exists()
    )
