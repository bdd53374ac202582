"""Dask clusters on this machine, and certificates for those that want them."""

import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from tests.samples.command_line import ROOT

ROLES = ("client", "scheduler", "worker")


def local_cluster(workers: int, **options: Any) -> Any:
    """Dask's own, of processes of this machine."""
    distributed = pytest.importorskip("distributed")
    return distributed.LocalCluster(
        **{"n_workers": workers, "threads_per_worker": 1, "processes": True, "dashboard_address": ":0"} | options
    )


def threads_cluster(workers: int, **options: Any) -> Any:
    """Its workers are threads of this process, which talk by TCP all the same."""
    return local_cluster(workers, **{"processes": False, "protocol": "tcp", "host": "127.0.0.1"} | options)


def port_of(cluster: Any) -> int:
    """Of its scheduler."""
    return int(cluster.scheduler_address.rpartition(":")[2])


def certificate(folder: Path, name: str = "lab") -> dict[str, str]:
    """A certificate that vouches for itself, as Dask's settings below distributed.comm: authority, certificate, key."""
    if shutil.which("openssl") is None:
        pytest.skip("openssl, which makes certificates, is not installed")
    key, cert = folder / f"{name}-key.pem", folder / f"{name}.pem"
    command = ["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2", "-subj", f"/CN={name}"]
    subprocess.run([*command, "-keyout", str(key), "-out", str(cert)], check=True, capture_output=True)
    roles = {f"tls.{role}.{what}": str(path) for role in ROLES for what, path in (("cert", cert), ("key", key))}
    return {"tls.ca-file": str(cert), **roles}


def as_environment(settings: dict[str, str]) -> dict[str, str]:
    """Settings below distributed.comm as environment variables."""
    prefix = "DASK_DISTRIBUTED__COMM__"
    return {prefix + name.upper().replace(".", "__").replace("-", "_"): value for name, value in settings.items()}


@contextmanager
def dask_commands(folder: Path, workers: int, *scheduler: str, **environment: str) -> Iterator[str]:
    """The address of a scheduler with workers, all started as a user would."""
    pytest.importorskip("distributed")
    file = folder / "scheduler.json"
    dask = [sys.executable, "-m", "dask"]
    known = ["--no-dashboard", "--scheduler-file", str(file)]
    commands = [[*dask, "scheduler", "--host", "127.0.0.1", "--port", "0", *known, *scheduler]]
    commands += [[*dask, "worker", "--nthreads", "1", *known]] * workers
    started: list[subprocess.Popen[bytes]] = []
    try:
        for command in commands:
            variables = os.environ | {"PYTHONPATH": str(ROOT)} | environment
            started.append(subprocess.Popen(command, env=variables, cwd=folder, stderr=subprocess.DEVNULL))
            while not file.exists() or not file.read_text().endswith("}"):
                assert started[-1].poll() is None, "the scheduler has ended"
                time.sleep(0.1)
        yield json.loads(file.read_text())["address"]
    finally:
        for process in reversed(started):
            process.terminate()
            process.wait()
