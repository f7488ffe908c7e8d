"""What the tests of generation share."""

from collections.abc import Iterator

import pytest

from plannerforge.engine.generation.site_network import forget_sites


@pytest.fixture
def unknown_sites() -> Iterator[None]:
    """The networks are built anew, and the next test knows none of them: for tests that have them built otherwise."""
    forget_sites()
    yield
    forget_sites()
