"""The profiles of the drive page. static/js/view/display/profiles.js has their contents, under the
same names. `standard` is the page as the robot's owner has set it up, and the baseline of studies.
"""

from typing import Literal, get_args

Interface = Literal["standard", "novice", "expert", "technical"]
INTERFACES: tuple[Interface, ...] = get_args(Interface)
