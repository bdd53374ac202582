"""The verbs of `sonarmap`, one per file: a function `command` whose parameters are the options and whose docstring is
the help. A new verb is a file here and a name in GROUPS of `tools/command/main.py`.
"""
