"""The demo's people, place and robots, created by the first start and kept by later ones. The
people's names are the same in every language.
"""

from pathlib import Path

from django.conf import settings
from django.contrib.admin.models import CHANGE, LogEntry

from accounts.models import User
from robots.models import Robot
from robots.plans.floorplans import store_floor_plan
from telepresence_site.environment import kept_secret
from telepresence_site.local_credentials import save_local_credentials

OFFICE = Path(settings.BASE_DIR) / "robots" / "world" / "plans" / "office"
VISITOR, RESEARCHER = "visitor", "researcher"
ROBOTS = (
    (
        "giraff",
        "Giraff",
        "A slender robot with a tilting head, at home in rooms and corridors.",
        "Un robot esbelto de cabeza inclinable, que se mueve bien por habitaciones y pasillos.",
        False,
    ),
    (
        "rhodon",
        "Rhodon",
        "A sturdy PatrolBot with an arm.",
        "Un PatrolBot robusto con un brazo.",
        True,
    ),
)


def seed(mqtt_url: str) -> str:
    """Create the demo's missing rows, describe robots again unless their owner edited them, and
    return the researcher's password.
    """
    plan = store_floor_plan(OFFICE)
    password = kept_secret(settings.VAR_DIR / "secrets" / "demo_researcher", 9)
    _make_visitor()
    owner = _researcher(password)
    for name, title, description, spanish, for_experienced in ROBOTS:
        described = {
            "title": title,
            "description": description,
            "translations": {"es": {"description": spanish}},
            "for_experienced": for_experienced,
        }
        robot, made = Robot.objects.get_or_create(
            name=name, defaults={**described, "owner": owner, "floor_plan": plan}
        )
        # An earlier version may have described it differently; edits by people stay.
        if not made and not LogEntry.objects.filter(
            content_type__app_label="robots",
            content_type__model="robot",
            object_id=str(robot.pk),
            action_flag=CHANGE,
        ):
            Robot.objects.filter(pk=robot.pk).update(**described)
        save_local_credentials(robot, mqtt_url)
    return password


def _make_visitor() -> None:
    visitor, made = User.objects.get_or_create(username=VISITOR, defaults={"display_name": "Alex"})
    if made:
        visitor.set_unusable_password()  # only the one-click link logs in
        visitor.save(update_fields=["password"])


def _researcher(password: str) -> User:
    researcher, made = User.objects.get_or_create(
        username=RESEARCHER,
        defaults={"display_name": "Robin", "is_staff": True, "is_superuser": True},
    )
    if made or not researcher.check_password(password):
        researcher.set_password(password)
        researcher.save(update_fields=["password"])
    return researcher
