"""The robot's side: what `manage.py run_robot` runs on the robot's own computer."""
