"""The Chromium of the tests: Debian's, without a window. Another is named by the environment
variable CHROMIUM.
"""

import os

# The same engine as chromium's own, without the parts of a desktop's browser: half of the work to
# start one, two thirds of it to play a video.
CHROMIUM = os.environ.get("CHROMIUM", "/usr/bin/chromium-headless-shell")
FLAGS = [
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--autoplay-policy=no-user-gesture-required",
]
