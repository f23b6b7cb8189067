"""`manage.py run_robot NAME`: the robot's agent; the same as `python -m robots.agent`."""

import os
from argparse import ArgumentParser
from typing import Any

from django.conf import settings
from django.core.management.base import BaseCommand, CommandError

from robots.agent.agent import agent_of, run_until_signalled
from robots.agent.config import ConfigError, add_arguments
from robots.agent.control.robot_check import check_robot, say_line
from robots.api.credentials_file import ENVIRONMENT
from robots.process import log_ids


class Command(BaseCommand):
    help = (
        "Run the agent of a robot: on the robot's own computer with --server "
        "and --credentials, or on the site's computer with its name only."
    )
    requires_system_checks: list[str] = []

    def add_arguments(self, parser: ArgumentParser) -> None:
        add_arguments(parser)

    def handle(self, *_args: Any, **options: Any) -> None:
        log_ids.of_process(robot=options["robot"])
        var = options["var"] or os.environ.get(f"{ENVIRONMENT}VAR") or settings.VAR_DIR
        try:
            if not options["check"]:
                run_until_signalled(agent_of({**options, "var": var}))
            elif not check_robot({**options, "var": var}, say_line):
                raise CommandError("The robot did not pass the check: see above.")
        except ConfigError as error:
            raise CommandError(str(error)) from error
