"""One file per verb of `sonarmap`: a function `command` whose parameters are the options and whose docstring is the
help. A new verb is a file here and a row of VERBS in `tools/command/main.py`.
"""
