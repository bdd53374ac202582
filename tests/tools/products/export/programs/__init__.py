"""Exports opened in the programs that offices use, where these are installed; each test says so where one is not."""
