"""The options --priors and --prior-sigmas: scans with what instruments measured of their poses."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from kernels.errors import InputError
from tools.cli.options import parse_prior_sigmas
from tools.cli.terminal import say

if TYPE_CHECKING:
    from spectral.scan import Scan


def scans_with_priors(
    scans: "Sequence[Scan]", priors: Path | None, prior_sigmas: str | None, imu: bool, allow_unknown: bool
) -> "Sequence[Scan]":
    """The scans with the priors of the file, and a note if some have none; without a file, the scans as they are.

    What a recording says of its scans' attitude counts only without a file, and a note says either.

    Args:
        scans: as they were read.
        priors, prior_sigmas, imu: the options.
        allow_unknown: whether the file may have rows for other scans.

    Raises:
        InputError: the file cannot be used, or there are --prior-sigmas without a file.
    """
    if priors is None:
        if prior_sigmas is not None:
            raise InputError("--prior-sigmas has no effect without --priors; give --priors too, or leave it out")
        _note_own(scans, "roll and pitch are those of the recording's own IMU" if imu else "their own IMU is not used")
        return scans if imu else _without_priors(scans)
    from tools.readers.navigation.priors import with_priors

    _note_own(scans, f"the recording's own IMU is not used, as {priors} is given")
    scans = _without_priors(scans)

    sigmas = parse_prior_sigmas(prior_sigmas) if prior_sigmas else {}
    notes: list[str] = []
    scans = with_priors(scans, priors, sigmas, allow_unknown, notes)
    for note in notes:
        say(note)
    bare = [scan.name for scan in scans if scan.prior is None]
    if bare:
        say(f"{len(bare)} of {len(scans)} scans have no prior in {priors}: {bare[0]}{' ...' if len(bare) > 1 else ''}")
    return scans


def _without_priors(scans: "Sequence[Scan]") -> "list[Scan]":
    return [scan if scan.prior is None else replace(scan, prior=None) for scan in scans]


def _note_own(scans: "Sequence[Scan]", note: str) -> None:
    own = sum(scan.prior is not None for scan in scans)
    if own:
        say(f"{own:,} of {len(scans):,} scans: {note}")
