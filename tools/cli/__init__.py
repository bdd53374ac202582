"""The `sonarmap` command: one thin file per verb, what they share beside them."""
