"""Seeds of the random generators of one dive."""


def entropy_of(*words: int, dive: int) -> list[int]:
    """The entropy of a generator's SeedSequence: `words`, and the dive's number unless it is the first dive."""
    return [*words] if dive == 1 else [*words, dive]
