"""The one exception of the package."""


class Error(RuntimeError):
    """Something usdlive refused or could not do.

    `code` is a name of errors.json ("layerNotFound"), the same in C++, on the wire and here;
    `message` says in one sentence what and where.
    """

    def __init__(self, code: str, message: str):
        super().__init__(f"{message} [{code}]")
        self.code = code
        self.message = message
