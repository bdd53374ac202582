"""How much compressed bytes may hold: far more than any scan or recording shrinks to, far less than what hurts."""

from sonarmap.kernels.errors import InputError

# Real points shrink a few times, clouds of which most is missing a hundred times, and an array of one value a thousand
# times: a small one is not refused for that.
_SMALL = 64 << 20
_RATIO = 100


def most_unpacked(packed: int) -> int:
    """To how many bytes some compressed ones may believably unpack."""
    return max(_SMALL, _RATIO * packed)


def require_believable(what: str, packed: int, plain: int) -> None:
    """Refuse what would take memory out of all proportion to the file.

    Args:
        what: claims it, in words.
        packed: its bytes in the file.
        plain: those in memory.

    Raises InputError: `plain` is more than `most_unpacked`.
    """
    if plain > most_unpacked(packed):
        raise InputError(
            f"{what} would make {plain:,} bytes of {packed:,}, which is not believable: the file is damaged, copy it "
            "again; if it is right, save it without compression"
        )
