"""The `sonarmap` command.

In: the user's command line. Out: results on stdout, messages on stderr, an exit code. `main.py` lists the verbs and
turns errors into messages; each verb is a file in `verbs/`; the other files hold options and texts that verbs share.
A verb checks its options, calls the library, and prints. What a user can fix is raised as an InputError.
"""
