"""The robot's side: what `manage.py run_robot` runs on the robot's own computer. Imports robots.api
and robots.world, and nothing else of ours.
"""
