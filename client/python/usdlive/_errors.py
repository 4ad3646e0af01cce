"""The exception of the package."""


class Error(RuntimeError):
    """An operation that usdlive refused or could not perform.

    `code` is the name of an ErrorCode ("layerNotFound"), the same in C++ and on the wire. A newer server may
    send others. `message` says in one sentence what failed and where.
    """

    def __init__(self, code: str, message: str):
        super().__init__(f"{message} [{code}]")
        self.code = code
        self.message = message
