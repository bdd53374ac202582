"""`sonarmap live`: recording, mapping and display, each in a process of its own."""
