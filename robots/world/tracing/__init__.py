"""From an occupancy grid to a proposal of a floor plan: walls, rooms, openings, obstacles, charging
stations. A person finishes it on a page of the administration.
"""
