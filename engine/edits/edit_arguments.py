"""Whether the arguments of an edit fit its operation."""

from plannerforge.schemas.errors import InvalidRequest
from plannerforge.schemas.modification import ARGUMENTS_OF, Edit


def check_arguments(edit: Edit) -> None:
    """Refuse arguments that do not belong to the operation, so that nothing asked for is silently left out.

    Raises:
        InvalidRequest: naming the argument and those that belong.
    """
    allowed = ARGUMENTS_OF[edit.op]
    foreign = [name for name in edit.given if name not in allowed]
    if foreign:
        raise InvalidRequest(
            f"{', '.join(foreign)} does not belong to op {edit.op}",
            valid=allowed,
            next_step="leave it out, or make it an edit of its own",
        )
