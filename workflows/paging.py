"""Answers in pages: the refusal of a page after the last entry."""

from ..schemas.errors import InvalidRequest, with_values


def check_offset(offset: int, total: int, what: str, page: int) -> None:
    """Refuse a page that starts after the last entry, unless there are no entries at all.

    Args:
        offset: the number of entries to skip.
        total: the number of entries.
        what: the entries' name in the plural.
        page: the number of entries on a page.

    Raises:
        InvalidRequest: all entries are skipped; the error suggests the last page.
    """
    if 0 < total <= offset:
        raise InvalidRequest(
            f"offset={offset} skips everything: there are {total:,} {what}",
            valid=[f"offset: 0 to {total - 1}"],
            next_step="choose a smaller offset",
            remedies=[with_values(offset=(total - 1) // page * page)],
            complete=True,
        )
