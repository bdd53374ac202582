"""The verbs that take something from a finished map."""
