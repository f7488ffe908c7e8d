"""What is kept of services' answers: whole, by what was asked, not too old, not too much."""

import os
import time
from pathlib import Path

from plannerforge.engine.maps.online.answers import AnswerCache, KeptAnswer


def kept(question: str, answer: object = "said", *, at: float | None = None) -> KeptAnswer:
    return KeptAnswer(question, "host", time.time() if at is None else at, answer)


def test_a_cached_answer_is_found_by_its_question_alone(tmp_path: Path) -> None:
    cache = AnswerCache(tmp_path, 1, 30)
    cache.keep(kept("where is Rome", [{"lat": "41.9"}]))
    found = AnswerCache(tmp_path, 1, 30).find("where is Rome")
    assert found is not None
    assert found.answer == [{"lat": "41.9"}]
    assert cache.find("where is Paris") is None


def test_an_old_answer_counts_only_if_age_does_not_matter(tmp_path: Path) -> None:
    cache = AnswerCache(tmp_path, 1, 30)
    cache.keep(kept("old", at=time.time() - 31 * 86_400))
    assert cache.find("old") is None
    assert cache.find("old", however_old=True) is not None


def test_a_damaged_answer_is_ignored_and_removed(tmp_path: Path) -> None:
    cache = AnswerCache(tmp_path, 1, 30)
    cache.keep(kept("cut"))
    (file,) = tmp_path.iterdir()
    file.write_bytes(file.read_bytes()[:-9])
    assert cache.find("cut") is None
    assert list(tmp_path.iterdir()) == []


def test_the_longest_unused_answers_are_removed_without_room(tmp_path: Path) -> None:
    cache = AnswerCache(tmp_path, 1, 30)
    noise = [os.urandom(150_000).hex() for _ in range(7)]
    for number, text in enumerate(noise):
        cache.keep(kept(f"q{number}", text))
        for age, file in enumerate(sorted(tmp_path.iterdir(), key=lambda path: -path.stat().st_mtime)):
            os.utime(file, (time.time() - 100 * (age + 1),) * 2)
        if number == 1:
            assert cache.find("q0") is not None  # used: it is the newest now
    assert sum(file.stat().st_size for file in tmp_path.iterdir()) <= 1024**2
    assert cache.find("q6") is not None
    assert cache.find("q0") is not None
    assert cache.find("q1") is None


def test_answer_from_long_after_now_is_requested_again(tmp_path: Path) -> None:
    """The clock was set back by a year since it was kept."""
    cache = AnswerCache(tmp_path, 1, 30)
    cache.keep(KeptAnswer("where is Rome", "a host", time.time() + 365 * 86_400, []))
    assert cache.find("where is Rome") is None
    assert cache.find("where is Rome", however_old=True) is not None
