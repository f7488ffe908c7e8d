"""Answers in pages: what is said if a page begins behind the last entry."""

from ..schemas.errors import InvalidRequest, with_values


def check_offset(offset: int, total: int, what: str, page: int) -> None:
    """Refuse a page that begins behind the last of all entries; nothing at all is no fault of the page.

    Args:
        offset: how many entries are left out.
        total: how many there are.
        what: what they are, in the plural.
        page: how many entries a page has.

    Raises:
        InvalidRequest: there are entries, and all of them are left out; the last page is proposed.
    """
    if 0 < total <= offset:
        raise InvalidRequest(
            f"offset={offset} leaves out all: there are {total:,} {what}",
            valid=[f"offset: 0 to {total - 1}"],
            next_step="choose a smaller offset",
            remedies=[with_values(offset=(total - 1) // page * page)],
            complete=True,
        )
