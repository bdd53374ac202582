"""The jobs of an experiment that are done, on disk as soon as each is: what a stopped run goes on from."""

import json
import math
import os
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from kernels.errors import InputError
from tools.reproduce.experiment import Outcome, Row
from tools.reproduce.provenance import Provenance
from tools.writers.json_text import to_json

FOLDER = ".journal"


@dataclass(frozen=True, slots=True)
class Done:
    """A job that is done.

    Attributes:
        outcome: what it found, as the journal keeps it.
        seconds: how long it took [s].
    """

    outcome: Outcome
    seconds: float


class Journal:
    """One JSON line on where the rows come from, then one for each job done.

    Numbers come back as they were, bit by bit; what is no finite number comes back as NaN. Whether a run was stopped
    cannot be seen in what it returns, as every outcome goes through the same text. Rows of other code, settings,
    devices or versions are in other files, named by their fingerprints.

    Attributes:
        path: OUT/.journal/NAME-<fingerprint>.jsonl.
        done: what was found there and what was added since, by job.
    """

    def __init__(self, folder: Path, provenance: Provenance, fresh: bool = False) -> None:
        """Read what is there; with `fresh`, or where its first line is not whole, begin anew.

        Raises:
            InputError: the file cannot be read or written.
        """
        self.path = folder / FOLDER / f"{provenance.name}-{provenance.fingerprint}.jsonl"
        self.done: dict[str, Done] = {}
        header = {"fingerprint": provenance.fingerprint} | to_json(provenance)
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            lines = [] if fresh or not self.path.exists() else _whole_lines(self.path.read_bytes())
            if lines and lines[0][1].get("fingerprint") == provenance.fingerprint:
                self.done = {line["job"]: _done(line) for _, line in lines[1:]}
                os.truncate(self.path, sum(size for size, _ in lines))
            else:
                self.path.write_bytes(_line(header))
        except OSError as error:
            raise self._unwritable(error) from error

    def add(self, job: str, outcome: Outcome, seconds: float) -> None:
        """Keep a job; it is on disk when this returns.

        Raises:
            InputError: it cannot be written; what was there before is as it was.
        """
        line = _line({"job": job, "took": seconds, "rows": outcome.rows, "seconds": outcome.seconds})
        try:
            before = self.path.stat().st_size
            try:
                with self.path.open("ab") as file:
                    file.write(line)
                    file.flush()
                    os.fsync(file.fileno())
            except OSError:
                with suppress(OSError):  # half a line may be there; the next run would cut it off as well
                    os.truncate(self.path, before)
                raise
        except OSError as error:
            raise self._unwritable(error) from error
        self.done[job] = _done(json.loads(line))

    def _unwritable(self, error: OSError) -> InputError:
        return InputError(
            f"cannot write {self.path}: {error.strerror or error}. Choose another output folder, or make room and "
            "check its permissions; the jobs that it holds are kept, and the same command goes on from there."
        )


def _line(content: Mapping[str, Any]) -> bytes:
    return (json.dumps(to_json(content), ensure_ascii=False, allow_nan=False) + "\n").encode()


def _whole_lines(content: bytes) -> list[tuple[int, dict[str, Any]]]:
    """Bytes and content of the lines up to the first that is torn or damaged."""
    lines = []
    for line in content.splitlines(keepends=True):
        try:
            parsed = json.loads(line) if line.endswith(b"\n") else None
        except ValueError:
            parsed = None
        if not isinstance(parsed, dict) or (lines and not parsed.keys() >= {"job", "took", "rows", "seconds"}):
            break
        lines.append((len(line), parsed))
    return lines


def _done(line: Mapping[str, Any]) -> Done:
    rows, seconds = (tuple(_row(row) for row in line[key]) for key in ("rows", "seconds"))
    return Done(Outcome(rows, seconds), line["took"])


def _row(row: Mapping[str, Any]) -> Row:
    return {key: math.nan if value is None else value for key, value in row.items()}
