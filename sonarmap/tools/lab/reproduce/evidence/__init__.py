"""What registrations measure of pairs of every sort, recorded with the truth, so that judging them is fitted to it."""
