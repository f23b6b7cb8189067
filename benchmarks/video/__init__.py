"""The video from the camera to the page: delay, load, and what a slow network makes of it."""
