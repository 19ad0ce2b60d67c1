"""Cases that only ``make test-long`` runs: others like them are in ``make test``."""

import pytest


def long(*values):
    """A case of a parametrised test."""
    return pytest.param(*values, marks=pytest.mark.long)
