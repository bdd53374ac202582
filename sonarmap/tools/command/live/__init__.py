"""`sonarmap live`: recording, mapping and showing, each in a process of its own."""
