"""Lists the robots of a site, or stops one or sends it to its station, over the JSON API.

robots.py URL                          one line for each robot
robots.py URL ROBOT stop|estop|dock    with the robot's key in the variable ROBOT_KEY
"""

import json
import os
import sys
import urllib.error
import urllib.request


class Site:
    """The JSON API of a site; `key` belongs to one robot, and may act on it."""

    def __init__(self, url, key=""):
        self.url, self.key = url.rstrip("/"), key

    def robots(self):
        return self._answer("robots/")["robots"]

    def act(self, robot, action):
        """Send a robot a command; its state shows what becomes of it."""
        return self._answer(f"robots/{robot}/actions/", {"type": action})

    def _answer(self, path, content=None):
        body = None if content is None else json.dumps(content).encode()
        request = urllib.request.Request(f"{self.url}/api/v1/{path}", data=body)
        request.add_header("Content-Type", "application/json")
        if self.key:
            request.add_header("Authorization", f"Bearer {self.key}")
        with urllib.request.urlopen(request, timeout=10) as answer:
            return json.load(answer)


def line_of(robot):
    charge = "" if robot["charge"] is None else f"{robot['charge']:.0%}".replace("%", " %")
    docked = "docked" if robot["docked"] else ""
    return f"{robot['name']:<15} {robot['state']:<10} {charge:>5}  {docked}".rstrip()


def main(url, robot=None, action=None):
    site = Site(url, os.environ.get("ROBOT_KEY", ""))
    try:
        if robot is None:
            print("\n".join(line_of(one) for one in site.robots()))
        else:
            site.act(robot, action)
    except urllib.error.HTTPError as refused:
        sys.exit(f"refused: {json.load(refused)['detail']}")


if __name__ == "__main__":
    main(*sys.argv[1:])
