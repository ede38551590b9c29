"""What a user can mend."""


class InputError(Exception):
    """The input or the call is wrong; the message says what, where and how to mend it.

    The command line prints it as ``error: WHAT, WHERE, HOW TO MEND`` and exits with status 2.
    """

    def __init__(self, what: str, where: str, how: str) -> None:
        super().__init__(f"{what}, {where}, {how}")
        self.what = what
        self.where = where
        self.how = how
