"""Robots: the site's models and pages, the Robot API, the simulated world, and the agent.

The GnuTLS in PyAV's wheel (and so in aiortc) reads its configuration when it is loaded, from a
folder under /tmp. Any user of the computer can create that folder, with a configuration that loads
code. Therefore only modules of `robots` load av, after the lines below have set the path of the
system's configuration, whether or not it exists. The wheel's ALSA has the same fault and is never
opened (robots/agent/devices/alsa.py); its VPL looks there for drivers, so no encoder of Intel's
(`*_qsv`) may be opened.

    https://www.gnutls.org/manual/html_node/System_002dwide-configuration-of-the-library.html

OpenBLAS reads the number of its threads when NumPy is loaded. Our arrays are small, and threads
that wait for each other cost many times what they save.

structlog would print events to standard output, among the output of commands: here it is set up to
pass them to the standard library's logging.
"""

import os

from robots.process import logs

os.environ.setdefault("GNUTLS_SYSTEM_PRIORITY_FILE", "/etc/gnutls/config")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
logs.configure()
