"""A recording on disk while it grows: under a name of its own, whole packets only, renamed when it has ended well."""

import os
from contextlib import suppress
from pathlib import Path

from sonarmap.kernels.errors import InputError

ENDING = ".sonar"


class PartFile:
    """NAME.part.sonar beside NAME.sonar. What an earlier recording left under such a name stays: this takes another.

    Attributes:
        path: of the part.
        size: bytes of the packets in it.
    """

    def __init__(self, out: Path, overwrite: bool) -> None:
        """Make an empty file, which will be called `out`; in place of a file of that name only to `overwrite` it.

        Raises InputError: it may not, or nothing can be written there.
        """
        self.out, self.size, self._overwrite = out, 0, overwrite
        if out.suffix != ENDING:
            raise InputError(f"{out} does not end in {ENDING}, by which recordings are recognized; try {out}{ENDING}")
        self._require_free()
        number = 1
        while True:
            self.path = out.with_name(f"{out.stem}.part{number if number > 1 else ''}{ENDING}")
            try:
                out.parent.mkdir(parents=True, exist_ok=True)
                self._file = self.path.open("xb", buffering=0)  # a packet is in the system's hands once it is written
                return
            except FileExistsError:
                number += 1
            except OSError as error:
                raise InputError(
                    f"cannot write {self.path}: {error.strerror}. Check the folder's permissions, or choose another."
                ) from error

    def write(self, packet: bytes) -> None:
        """Append a packet, all of it or nothing.

        Raises InputError: the disk takes no more. The packets before are in the file.
        """
        left = memoryview(packet)
        try:
            while left:
                left = left[self._file.write(left) :]
        except OSError as error:
            with suppress(OSError):
                self._file.truncate(self.size)
            raise InputError(
                f"the recording ended, as {self.path} cannot grow: {error.strerror}. What came until then can be read "
                "from it. Make room, or record to another disk."
            ) from error
        self.size += len(packet)

    def sync(self) -> None:
        """Have the disk hold what was written, for a crash of the computer."""
        with suppress(OSError):  # where the disk is full, writing says so
            os.fsync(self._file.fileno())

    def finish(self) -> None:
        """Give it its name. Raises InputError: a file of that name has come, or the disk refuses; the part stays."""
        try:
            os.fsync(self._file.fileno())
            self._file.close()
            self._require_free()
            self.path.replace(self.out)
        except OSError as error:
            raise InputError(
                f"cannot write {self.out}: {error.strerror}. The recording is in {self.path}; what was there before is "
                "as it was."
            ) from error
        except InputError as error:
            raise InputError(f"{error}. The recording is in {self.path}.") from error

    def close(self) -> None:
        """End without giving it its name; removed if nothing came."""
        with suppress(OSError):
            self._file.close()
            if self.size == 0:
                self.path.unlink(missing_ok=True)

    def _require_free(self) -> None:
        if self.out.is_dir():
            raise InputError(f"cannot write {self.out}: a folder of that name is there; choose another name")
        if self.out.exists() and not self._overwrite:
            raise InputError(f"{self.out} is there already; choose another name, or give --overwrite to replace it")
