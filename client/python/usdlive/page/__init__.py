"""The gateway of the page: shows a live project in browsers (docs/page.md). `usdlive page URL` starts it.

It is an ordinary client of the server. One thread owns the client and the composed stage (`picture`), reads what there is
to draw (`scene`) and makes messages of it, which an ASGI application (`app`) sends to all viewers.
"""
