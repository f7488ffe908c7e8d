"""The tutorial shows what the server answers today: ``make tutorial-page`` records it and its pictures."""

from types import ModuleType

import numpy as np
import pytest
from PIL import Image
from support.tree import CHECKOUT, loaded_script

from plannerforge.server.settings import Settings

LARGEST_DIFFERENCE = 8.0
"""Of the mean grey of an eighth of a picture each way, in levels of 255: other fonts move letters, nothing else."""


@pytest.fixture(scope="module")
def recording() -> ModuleType:
    """The script that records the page."""
    return loaded_script("record_tutorial")


def coarse(picture: Image.Image) -> np.ndarray:
    """The picture in squares of about 120 pixels, in grey."""
    return np.asarray(picture.convert("L").resize((8, 8), Image.Resampling.BOX), dtype=float)


@pytest.mark.anyio
@pytest.mark.usefixtures("starter_ready", "warm_workers")
async def test_the_tutorial_shows_answers_and_pictures_of_today(recording: ModuleType, settings: Settings) -> None:
    shown = recording.PAGE.read_text(encoding="utf-8")
    made = await recording.recorded(shown, settings)
    assert made.page == shown, "run make tutorial-page and look at the difference"
    assert set(made.pictures) == set(recording.PICTURES)
    for name, picture in made.pictures.items():
        stored = Image.open(CHECKOUT / "docs" / "tutorial" / f"{name}.webp")
        assert stored.size == picture.size, name
        assert np.abs(coarse(stored) - coarse(picture)).max() <= LARGEST_DIFFERENCE, name


def test_a_command_that_is_not_a_call_is_refused(recording: ModuleType, settings: Settings) -> None:
    import anyio

    with pytest.raises(ValueError, match="makes calls only"):
        anyio.run(recording.recorded, "```console\n$ plannerforge tools {} {}\n```\n", settings)
