"""A separate system for bots, in a folder of its own: database, broker, session manager, web
server, and one simulated robot of each kind.

It shares nothing with the site that creates it: a study goes in as a file, and the findings come
out as one. Its processes may run faster than real time (experiments/bots/pace.py), which the site's
own must never do.
"""

import copy
import os
import shutil
import time
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
from robots.models import FloorPlan, Robot, RobotPresence
from robots.plans.floorplans import store_floor_plan
from robots.world.sites import shipped_sites
from sessions.models import ManagerBeat
from surveys.models import Questionnaire as QuestionnaireRow
from telepresence_site.children import Child, Children
from telepresence_site.demo.ports import LOOPBACK, answers, free_port, listening
from telepresence_site.demo.seed import OFFICE
from telepresence_site.demo.supervision import DemoPart, RestartPolicy, ServiceSupervisor
from telepresence_site.serving import APPLICATION, DAPHNE

STUDY_FILE = "study.json"
START_SECONDS = 600.0  # for each part: the computer may be busy with other work
FPS = "6"  # of the cameras: bots take four pictures a second, and drawing them costs most
KEPT_FOLDERS = 3  # with the logs of the last sandboxes
NOT_INHERITED = (
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


@contextmanager
def sandbox_folder(name: str) -> Iterator[Path]:
    """Yield a new folder for a sandbox; of older ones only the last few stay, for their logs."""
    home: Path = settings.VAR_DIR / "sandboxes"
    home.mkdir(parents=True, exist_ok=True)
    folders = sorted(home.iterdir(), key=lambda path: path.stat().st_mtime)
    for old in folders[: -KEPT_FOLDERS + 1]:
        shutil.rmtree(old, ignore_errors=True)
    folder = home / f"{name}-{time.time_ns()}"
    folder.mkdir()
    yield folder


def pack(row: Study, folder: Path) -> None:
    """Write a study, its questionnaires and the plans of its sites into a folder."""
    definition = row.as_definition()
    asked = {(step.questionnaire, step.version) for step in definition.questionnaire_steps}
    questionnaires = [
        one for one in QuestionnaireRow.objects.all() if (one.slug, one.version) in asked
    ]
    sites = {condition.site for condition in definition.conditions}
    study = copy.copy(row)
    study.published_by = None  # this user does not exist in the sandbox
    rows = [*FloorPlan.objects.filter(name__in=sites), *questionnaires, study]
    folder.mkdir(parents=True, exist_ok=True)
    (folder / STUDY_FILE).write_text(serializers.serialize("json", rows), encoding="utf-8")


def environment(folder: Path, given: dict[str, str]) -> dict[str, str]:
    """Return the environment of the sandbox's processes, without addresses of the site's services
    and without settings of agents.
    """
    inherited = {
        name: value
        for name, value in given.items()
        if name not in NOT_INHERITED and not name.startswith(ENVIRONMENT)
    }
    return inherited | {
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


def unpack() -> Study:
    """Create the sandbox's database in this process, and return the study as a draft in it."""
    call_command("migrate", verbosity=0)
    packed = (settings.VAR_DIR / STUDY_FILE).read_text(encoding="utf-8")
    for loaded in serializers.deserialize("json", packed):
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
    """Return the series and site of each robot by its name, which is the series, numbered where
    there are several robots of it.
    """
    pairs = dict.fromkeys((one.robot, one.site) for one in definition.conditions)
    series = [name for name, _site in pairs]
    return {
        (name if series.count(name) == 1 else f"{name}-{number}"): (name, site)
        for number, (name, site) in enumerate(pairs, 1)
    }


@contextmanager
def running(definition: StudyDefinition, sites: Path) -> Iterator[str]:
    """Run the sandbox's servers and robots inside, and yield the address of its site.

    Args:
        definition: the study.
        sites: the folder with plans of sites that the project does not include.

    Raises:
        PartLostError: one of them did not start, or has ended.
    """
    children = Children(settings.VAR_DIR / "log", {**os.environ})
    supervisor = ServiceSupervisor(children, print, RestartPolicy(quick_deaths=1))
    site, parts = _parts(definition, sites)
    try:
        supervisor.start(parts, within=START_SECONDS)
        yield site
        supervisor.look()  # if one has ended, the findings of the bots do not concern the study
    finally:
        children.stop()


def _parts(definition: StudyDefinition, sites: Path) -> tuple[str, list[DemoPart]]:
    """Return the site's address and its processes."""
    manage = str(settings.BASE_DIR / "manage.py")
    mqtt_port, web_port = int(settings.MQTT_URL.rpartition(":")[2]), free_port()
    site = f"http://{LOOPBACK}:{web_port}"
    broker = [manage, "run_broker", "--host", LOOPBACK, "--port", str(mqtt_port)]
    web = [*DAPHNE, "-b", LOOPBACK, "-p", str(web_port), APPLICATION]
    processes: dict[str, tuple[list[str], Callable[[Child], bool]]] = {
        "broker": (broker, lambda _child: listening(mqtt_port)),
        "session manager": (
            [manage, "run_session_manager"],
            lambda _child: ManagerBeat.objects.exists(),
        ),
        "web server": (web, lambda _child: answers(site)),
    }
    for name, (series, plan) in _robots(definition).items():
        where = plan if plan in shipped_sites() else str(sites / plan)
        options = [f"--option={key}={value}" for key, value in (("plan", where), ("fps", FPS))]
        command = [manage, "run_robot", name, "--profile", series, *options]
        processes[f"simulated {name}"] = (command, _online(name))
    return site, [DemoPart(name, *how, is_essential=True) for name, how in processes.items()]


def _online(name: str) -> Callable[[Child], bool]:
    return lambda _child: (
        RobotPresence.objects.filter(robot__name=name, connection="ONLINE")
        .exclude(factsheet=None)
        .exists()
    )
