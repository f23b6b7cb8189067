"""How well a robot knows where it is, navigates, docks and helps its driver, by simulation."""
