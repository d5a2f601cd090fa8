"""Kernels as plain Python: one function, or a process in which nothing is compiled."""

import json
import os
import subprocess
import sys
from typing import Any


def uncompiled(kernel: Any) -> Any:
    """What numba compiles, also where it compiles nothing."""
    return getattr(kernel, "py_func", kernel)


def in_plain_python(module: str, expression: str) -> Any:
    """What an expression gives, of a test module known as `t`, in a process that compiles nothing."""
    code = f"import json, {module} as t; print(json.dumps({expression}))"
    here = os.path.dirname(__file__)
    path = os.pathsep.join([here, os.path.dirname(here)])
    env = os.environ | {"NUMBA_DISABLE_JIT": "1", "PYTHONPATH": path, "PYTHONWARNINGS": "ignore"}
    done = subprocess.run([sys.executable, "-c", code], env=env, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-2000:]
    return json.loads(done.stdout)
