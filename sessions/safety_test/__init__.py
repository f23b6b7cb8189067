"""The test of a robot's safety functions that its owner starts: rules, course and page."""
