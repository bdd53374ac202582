"""How long a pair takes, by every method: the same pairs, in turn, in one process."""
