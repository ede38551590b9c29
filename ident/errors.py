"""What a user can mend."""

from __future__ import annotations


class InputError(Exception):
    """The input or the call is wrong; the message says what, where and how to mend it.

    The command line prints it as ``error: WHAT, WHERE, HOW TO MEND`` and exits with status 2.

    Args:
        what: is wrong, with the value that was found.
        where: a file and row, an option, a part of a card.
        how: to mend it.
    """

    def __init__(self, what: str, where: str, how: str) -> None:
        super().__init__(f"{what}, {where}, {how}")
        self.what = what
        self.where = where
        self.how = how

    def __reduce__(self) -> tuple[type[InputError], tuple[str, str, str]]:
        """Survive the way from a worker process."""
        return type(self), (self.what, self.where, self.how)
