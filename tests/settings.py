"""The site's settings with what tests change: plain http, static files that were collected, quick
password hashes, and a directory of their own.
"""

import atexit
import os
import shutil
import tempfile

if "VAR_DIR" not in os.environ:
    os.environ["VAR_DIR"] = tempfile.mkdtemp(prefix="telepresence-tests-")
    atexit.register(shutil.rmtree, os.environ["VAR_DIR"], ignore_errors=True)
os.environ.setdefault("HTTP_ONLY", "1")
os.environ.setdefault("LOG_LEVEL", "WARNING")

from telepresence_site.settings import *  # noqa: F403 -- the settings of the site, and more

PASSWORD_HASHERS = ["django.contrib.auth.hashers.MD5PasswordHasher"]
STORAGES["staticfiles"] = {  # noqa: F405 -- as above
    "BACKEND": "tests.support.collected.CollectedFiles",
}
STATICFILES_FINDERS = ["tests.support.collected.CollectedFinder"]
WHITENOISE_USE_FINDERS = WHITENOISE_AUTOREFRESH = True
STATIC_ROOT.mkdir(parents=True, exist_ok=True)  # noqa: F405 -- WhiteNoise warns where none is
