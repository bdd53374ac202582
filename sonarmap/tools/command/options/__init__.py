"""Options that several verbs share, with their checks: one file for each of what they are about."""
