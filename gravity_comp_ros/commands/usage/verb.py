"""Registry of the verbs of the command line."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass

AddArguments = Callable[[argparse.ArgumentParser], None]


@dataclass(frozen=True)
class Verb:
    """Description in one line, text after the options, and the function that adds these."""

    text: str
    epilog: str
    add_arguments: AddArguments


# All verbs by name, in the order of the overview.
VERBS: dict[str, Verb] = {}


def verb(text: str, epilog: str) -> Callable[[AddArguments], AddArguments]:
    """Return a decorator that registers the verb whose arguments a function of its name adds."""
    def register(add_arguments: AddArguments) -> AddArguments:
        VERBS[add_arguments.__name__] = Verb(text, epilog, add_arguments)
        return add_arguments
    return register
