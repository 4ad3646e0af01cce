"""Runs the gateway: `python -m usdlive.page` is `usdlive page` of this installation."""

import sys

from .command import main

sys.exit(main(sys.argv[1:]))
