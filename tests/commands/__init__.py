"""The commands of README and docs: every option exists, and what can run runs as it is written."""
