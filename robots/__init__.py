"""Robots: what the site knows of them, the words on the wire, the world, and the agent.

PyAV's wheel (and with it aiortc) brings a GnuTLS that reads its configuration when it is loaded,
and was built to look for it in a folder under /tmp, which any user of the computer may make: with a
provider of code to load in it. So only modules of `robots` load av, after the lines below have set
the path of the system's configuration, whether or not it exists. The wheel's ALSA has the same
fault and is never opened (robots/agent/devices/alsa.py); its VPL looks there for drivers, so no
encoder of Intel's (`*_qsv`) may be opened.

    https://www.gnutls.org/manual/html_node/System_002dwide-configuration-of-the-library.html

The arrays of site, agent and simulator are small: threads of OpenBLAS that wait for each other cost
many times what they save. It reads how many to start when NumPy is loaded.

Events are logged by structlog, which would print them to standard output, between what programs
answer there: so whatever imports `robots` has them handed to the standard library's logging.
"""

import os

from robots import logs

os.environ.setdefault("GNUTLS_SYSTEM_PRIORITY_FILE", "/etc/gnutls/config")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
logs.configure()
