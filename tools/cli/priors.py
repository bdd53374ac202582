"""The options --priors and --prior-sigmas: scans with what else is known of their poses."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from kernels.errors import InputError
from tools.cli.options import parse_prior_sigmas
from tools.cli.terminal import say

if TYPE_CHECKING:
    from spectral.scan import Scan


def told_priors(
    scans: "Sequence[Scan]", priors: Path | None, prior_sigmas: str | None, strangers: bool
) -> "Sequence[Scan]":
    """The scans with the priors of the file, and a note where some have none; as they are without a file.

    Args:
        scans: as they were read.
        priors, prior_sigmas: the options.
        strangers: whether the file may tell of other scans too.

    Raises:
        InputError: the file cannot be used, or there is none that --prior-sigmas could be of.
    """
    if priors is None:
        if prior_sigmas is not None:
            raise InputError("--prior-sigmas is of the file that --priors names; give that too, or drop it")
        return scans
    from tools.readers.priors import with_priors

    sigmas = parse_prior_sigmas(prior_sigmas) if prior_sigmas else {}
    told = with_priors(scans, priors, sigmas, strangers)
    bare = [scan.name for scan in told if scan.prior is None]
    if bare:
        say(f"{len(bare)} of {len(told)} scans have no prior in {priors}: {bare[0]}{' ...' if len(bare) > 1 else ''}")
    return told
