"""The Chromium of the tests: Debian's, headless, or the one that the variable CHROMIUM names."""

import os

# The engine without the desktop browser: half of the CPU time to start, two thirds to play a video.
CHROMIUM = os.environ.get("CHROMIUM", "/usr/bin/chromium-headless-shell")
FLAGS = [
    *("--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-sync"),
    *("--disable-background-networking", "--disable-component-update"),
    "--autoplay-policy=no-user-gesture-required",
]
