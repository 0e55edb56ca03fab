"""Verbs of the command line: one module each, with `run`; `usage` has their arguments."""
