"""Every option of every verb as a setting: its unit, its default, and a TOML file that sets it.

In: the verbs as Typer has them, and a file. Out: values that take the place of the defaults, and what `sonarmap config`
lists. `setting.py` reads the options, `file.py` the file; `in_force.py` says what counts when a verb runs.
"""
