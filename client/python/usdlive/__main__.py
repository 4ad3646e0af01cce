"""Runs the command line tool: `python -m usdlive VERB ...` is `usdlive VERB ...` of this installation."""

from usdlive_program import usdlive

usdlive()
