"""Shared fixtures of the generation tests."""

from collections.abc import Iterator

import pytest

from plannerforge.engine.generation.site_network import forget_sites


@pytest.fixture
def unknown_sites() -> Iterator[None]:
    """Clears known sites before and after, for tests that build networks differently."""
    forget_sites()
    yield
    forget_sites()
