"""All checks in their order; one that fails itself is a finding too."""

import traceback
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from sonarmap.tools.command.doctor import libraries, memory, storage, system
from sonarmap.tools.command.doctor.finding import Finding, Remedy

if TYPE_CHECKING:
    from sonarmap.kernels.child import Answers


def examine(folder: Path, quick: bool) -> Iterator[Finding]:
    """Look at everything: the findings, each as soon as it is known. `folder` is where results go; `quick` loads no
    library and runs no self-test."""
    yield _checked("Python", libraries.python_version)
    yield _checked("libraries", lambda: libraries.required_libraries(load=not quick))
    yield _checked("optional", libraries.optional_libraries)
    answers: Answers | None = None

    def check_opencl() -> Finding:
        from sonarmap.tools.command.doctor import opencl  # whose room `kernels` needs a library itself

        nonlocal answers
        finding, answers = opencl.opencl(test=not quick)
        return finding

    yield _checked("OpenCL", check_opencl)
    yield _checked("memory", lambda: memory.memory(answers))
    yield _checked("cores", system.cores)
    yield _checked("disk", lambda: storage.results(folder))
    yield _checked("temporary", storage.temporary_folder)
    yield _checked("caches", storage.caches)
    yield _checked("open files", system.open_files)
    yield _checked("network", system.receive_buffer)
    yield _checked("text", system.encoding)


def _checked(name: str, check: Callable[[], Finding]) -> Finding:
    try:
        return check()
    except ImportError as error:
        module = error.name or "what is missing"
        remedy = Remedy("install it:", libraries.pip_command(module)) if error.name else Remedy("see libraries")
        return Finding(name, "wrong", f"cannot be checked: {error}", (remedy,))
    except MemoryError:
        return Finding(name, "wrong", "cannot be checked: no memory is left", (Remedy("end other programs"),))
    except Exception as error:  # noqa: BLE001 - here of all places a broken installation must not end the program
        frame = traceback.extract_tb(error.__traceback__)[-1]
        place = f"{Path(frame.filename).name}, line {frame.lineno}"
        return Finding(name, "wrong", f"cannot be checked: {type(error).__name__}: {error} ({place})")
