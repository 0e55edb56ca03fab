"""Parameters of tests that only `make bench` runs."""

import pytest


def campaign(*cases):
    """Return parameters with the mark `campaign`; a tuple has one value for each argument."""
    return [pytest.param(*(case if isinstance(case, tuple) else (case,)),
                         marks=pytest.mark.campaign) for case in cases]
