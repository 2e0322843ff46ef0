"""Programs in forks of one process that has loaded their libraries: each has a process of its own,
and loads none again.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

_SERVER = """
import importlib, json, os, runpy, sys, traceback
for name in sys.argv[1:]:
    importlib.import_module(name)
for line in sys.stdin:
    job = json.loads(line)
    child = os.fork()
    if child:
        print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)
        continue
    os.chdir(job["folder"])
    os.environ.update(job["environment"])
    for number, name in enumerate((os.devnull, job["out"], job["err"])):
        os.dup2(os.open(name, os.O_RDWR | os.O_CREAT, 0o600), number)
    code = 1
    try:
        sys.argv = job["arguments"]
        if sys.argv[0] == "-c":
            exec(compile(job["code"], "<code>", "exec"), {"__name__": "__main__"})
        else:
            runpy.run_path(sys.argv[0], run_name="__main__")
        code = 0
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else 0 if end.code is None else 1
    except BaseException:
        traceback.print_exc()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)
"""


class Warm:
    """The process, with some modules loaded; close it."""

    def __init__(self, *modules: str) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-c", _SERVER, *modules],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )

    def run(
        self,
        scratch: Path,
        folder: Path,
        arguments: Sequence[str],
        code: str = "",
        environment: dict[str, str] | None = None,
    ) -> tuple[int, str, str]:
        """Exit code and output of a Python program (its path, or ``-c`` with ``code``) that is run
        in ``folder``.
        """
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        out = scratch / "stdout"
        err = scratch / "stderr"
        for path in (out, err):
            path.unlink(missing_ok=True)
        job = {
            "folder": str(folder),
            "arguments": list(arguments),
            "code": code,
            "environment": environment or {},
        }
        self._process.stdin.write(json.dumps(job | {"out": str(out), "err": str(err)}) + os.linesep)
        self._process.stdin.flush()
        status = self._process.stdout.readline()
        assert status, "the process has ended"
        return int(status), out.read_text(encoding="utf-8"), err.read_text(encoding="utf-8")

    def close(self) -> None:
        """End the process."""
        self._process.communicate()
