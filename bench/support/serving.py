"""The server of a benchmark."""

from __future__ import annotations

import os
import pathlib
import subprocess
import tempfile
import time


def serve(project: pathlib.Path, *options: str, program: tuple = (), **process) -> tuple[subprocess.Popen, int]:
    """Starts a server for a project. Returns its process and its port, which nobody else used. `program`: the words of
    another command than that of `USDLIVE_SERVER_BIN`. `process`: further arguments of `Popen`. Raises RuntimeError if the
    server ends."""
    with tempfile.TemporaryDirectory() as folder:
        port = pathlib.Path(folder, "port")
        command = [*(program or [os.environ["USDLIVE_SERVER_BIN"]]), project, "--port", "0", "--port-file", port, *options]
        server = subprocess.Popen(command, stdout=subprocess.DEVNULL, **process)
        while not port.exists() or not port.read_text():
            if server.poll() is not None:
                raise RuntimeError(f"the server has ended with {server.returncode}")
            time.sleep(0.01)
        return server, int(port.read_text())
