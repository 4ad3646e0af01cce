"""The one exception of the package."""


class Error(RuntimeError):
    """Something usdlive refused or could not do.

    `code` is the name of an ErrorCode ("layerNotFound"), the same in C++, on the wire and here; a newer
    server may have others. `message` says in one sentence what and where.
    """

    def __init__(self, code: str, message: str):
        super().__init__(f"{message} [{code}]")
        self.code = code
        self.message = message
