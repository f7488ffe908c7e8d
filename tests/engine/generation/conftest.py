"""What the tests of generation share."""

from collections.abc import Iterator

import pytest

from plannerforge.engine.generation.site_network import forget_sites


@pytest.fixture(autouse=True)
def _unknown_sites() -> Iterator[None]:
    """Every test builds its networks itself: some have them built otherwise."""
    forget_sites()
    yield
    forget_sites()
