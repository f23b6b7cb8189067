#!/usr/bin/env python
"""Command line of the telepresence server and of the robot's agent."""

import os
import sys

from telepresence import __version__


def main() -> None:
    """Run a management command."""
    if sys.argv[1:] in (["version"], ["--version"]):  # Django would print its own
        print(__version__)
        return
    os.environ.setdefault("DJANGO_SETTINGS_MODULE", "telepresence_site.settings")
    from django.core.management import execute_from_command_line  # noqa: PLC0415 -- settings first

    execute_from_command_line(sys.argv)


if __name__ == "__main__":
    main()
