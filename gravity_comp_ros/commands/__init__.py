"""The verbs of the command line: one module each, with `run`; `usage` says what they take."""
