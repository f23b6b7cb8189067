"""The robot's side: what `manage.py run_robot` runs on the robot's own computer. Of ours it imports
robots.api, robots.world, and four small modules that CONTRIBUTING.md names.
"""
