#!/bin/sh
# Makes the virtual environment: set_up.sh PYTHON VENV LOCK. One clear sentence for whatever is missing.
set -eu
if ! command -v "$1" >/dev/null 2>&1; then
    echo "Python is missing: install it with 'sudo apt install python3 python3-venv', or name one with 'make PYTHON=/path/to/python3.11'." >&2
    exit 1
fi
exec "$1" deploy/set_up.py "$2" "$3"
