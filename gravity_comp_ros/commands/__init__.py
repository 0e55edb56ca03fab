"""The verbs of the command line: one module each, with VERB, HELP, EPILOG and `run`."""
