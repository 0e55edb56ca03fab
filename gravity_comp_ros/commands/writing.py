"""Names of files that verbs write."""

from __future__ import annotations

import argparse
from pathlib import Path


def mcap_file(text: str) -> Path:
    """Return the path of an MCAP file to write; another ending is surely a slip."""
    path = Path(text)
    if path.suffix != '.mcap':
        raise argparse.ArgumentTypeError(f'{text} does not end in .mcap')
    return path
