"""A folder for each kind of robot control architecture; robots/agent/robot_interface.py says what
each must do.
"""
