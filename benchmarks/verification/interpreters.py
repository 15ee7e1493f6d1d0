"""Interpreters that have another program."""

from __future__ import annotations

import functools
import os
import shutil
import subprocess
import sys


@functools.cache
def interpreter(module: str, variable: str) -> str | None:
    """The interpreter that a variable of the environment names, or None if it lacks the module.

    Without the variable it is the first that imports the module: the present one, that of the path
    or that of the system.
    """
    named = os.environ.get(variable)
    usual = [sys.executable, shutil.which("python3"), "/usr/bin/python3"]
    for python in filter(None, map(shutil.which, filter(None, [named] if named else usual))):
        call = [python, "-c", f"import {module}"]
        if subprocess.run(call, capture_output=True, check=False).returncode == 0:
            return python
    return None
