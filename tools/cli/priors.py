"""The options --priors and --prior-sigmas: scans with what the vehicle measured of their poses."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from kernels.errors import InputError
from tools.cli.options import parse_prior_sigmas
from tools.cli.terminal import say

if TYPE_CHECKING:
    from spectral.scan import Scan


def scans_with_priors(
    scans: "Sequence[Scan]", priors: Path | None, prior_sigmas: str | None, allow_unknown: bool
) -> "Sequence[Scan]":
    """The scans with the priors of the file, and a note if some have none; without a file, the scans as they are.

    Args:
        scans: as they were read.
        priors, prior_sigmas: the options.
        allow_unknown: whether the file may have rows for other scans.

    Raises:
        InputError: the file cannot be used, or there are --prior-sigmas without a file.
    """
    if priors is None:
        if prior_sigmas is not None:
            raise InputError("--prior-sigmas has no effect without --priors; give --priors too, or leave it out")
        return scans
    from tools.readers.priors import with_priors

    sigmas = parse_prior_sigmas(prior_sigmas) if prior_sigmas else {}
    notes: list[str] = []
    scans = with_priors(scans, priors, sigmas, allow_unknown, notes)
    for note in notes:
        say(note)
    bare = [scan.name for scan in scans if scan.prior is None]
    if bare:
        say(f"{len(bare)} of {len(scans)} scans have no prior in {priors}: {bare[0]}{' ...' if len(bare) > 1 else ''}")
    return scans
