"""Modules of ours that an adapter runs in a process of their own."""

import os
import subprocess
import sys
from pathlib import Path
from typing import Any


def start_module(*command: str, **pipes: Any) -> subprocess.Popen[bytes]:
    """Start `python -m` with this command, in milliseconds; raises OSError."""
    # One thread for linear algebra: the matrices are small, and idle threads would spin beside the
    # agent.
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    return subprocess.Popen(
        [sys.executable, "-m", *command],
        # outside the terminal's process group: on Ctrl-C the agent brakes before it ends the child
        start_new_session=True,
        creationflags=getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0),
        # the folder of `robots`, so that the child can import it
        cwd=str(Path(__file__).resolve().parents[4]),
        env=environment,
        **pipes,
    )
