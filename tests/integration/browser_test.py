"""Tests what a page of another site can do with a server on the artist's machine, with a real browser (HO1, AC1)."""

from __future__ import annotations

import http.server
import json
import threading

import pytest
from page_screen import CHROMIUM
from playwright.sync_api import sync_playwright

ROOT = '#usda 1.0\n\ndef "World"\n{\n    double secret = 42\n}\n'
# Tries everything that a page can try without the user's help, and writes into itself what it got.
PAGE = """<!doctype html><title>a page of another site</title><pre id="found"></pre><script>
const server = "127.0.0.1:PORT", found = {};
const session = () => new Promise(done => {
  const socket = new WebSocket(`ws://${server}/live`);
  socket.onopen = () => done("open");
  socket.onerror = () => done("refused");
});
const text = async (path, options) => {
  try { const answer = await fetch(`http://${server}${path}`, options); return answer.type + " " + await answer.text(); }
  catch (error) { return "refused"; }
};
const image = () => new Promise(done => {
  const picture = new Image();
  picture.onload = () => done("open");
  picture.onerror = () => done("refused");
  picture.src = `http://${server}/files/picture.png`;
});
(async () => {
  found.session = await session();
  found.files = await text("/files/root.usda");
  found.blind = await text("/files/root.usda", {mode: "no-cors"});
  found.join = await text("/join", {method: "POST", headers: {Authorization: "Invitation x"}});
  found.picture = await image();
  document.getElementById("found").textContent = JSON.stringify(found);
  document.title = "done";
})();
</script>"""
# The smallest picture of PNG.
PNG = bytes.fromhex("89504e470d0a1a0a0000000d4948445200000001000000010806000000"
                    "1f15c4890000000d49444154789c6360000002000001e221bc330000000049454e44ae426082")


class Site:
    """Another site: an HTTP server at another port, which is another origin."""

    def __init__(self):
        site = self

        class Handler(http.server.BaseHTTPRequestHandler):
            def do_GET(self):
                self.send_response(200)
                self.send_header("Content-Type", "text/html")
                self.end_headers()
                self.wfile.write(site.page.encode())

            def log_message(self, *_):
                pass

        self.page = ""
        self.server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.origin = f"http://127.0.0.1:{self.server.server_address[1]}"
        threading.Thread(target=self.server.serve_forever, daemon=True).start()


@pytest.fixture
def site():
    made = Site()
    yield made
    made.server.shutdown()
    made.server.server_close()


def visit(url: str) -> dict:
    """Returns what the page has found in a browser."""
    with sync_playwright() as started:
        browser = started.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        tab = browser.new_page()
        tab.goto(url)
        tab.wait_for_function("document.title === 'done'", timeout=60_000)
        found = json.loads(tab.inner_text("#found"))
        browser.close()
    return found


@pytest.fixture
def root(project):
    (project / "root.usda").write_text(ROOT)
    (project / "picture.png").write_bytes(PNG)
    return project


def test_a_page_of_another_site_reads_and_edits_nothing(root, serve, site):
    server = serve(root)
    site.page = PAGE.replace("PORT", str(server.port))
    found = visit(site.origin)
    assert found["session"] == "refused"
    assert found["files"] == found["join"] == "refused"
    assert "secret" not in found["blind"]
    assert found["picture"] == "refused"


def test_a_page_that_the_server_allows_opens_a_session(root, serve, site):
    """The page and the browser of the test above work."""
    server = serve(root, "--allow-origin", site.origin)
    site.page = PAGE.replace("PORT", str(server.port))
    assert visit(site.origin)["session"] == "open"
