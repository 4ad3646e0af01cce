"""Checks that each link of a document leads to a file of the repository, and to a heading in it."""

import pathlib
import re
import subprocess

ROOT = pathlib.Path(__file__).resolve().parents[2]
LINK = re.compile(r"\]\(([^()\s]+)\)")


def anchors(text):
    """The anchors of the headings, as GitHub makes them."""
    headings = re.findall(r"^#+ (.+)$", text, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading).strip().lower().replace(" ", "-") for heading in headings}


def broken(document):
    for link in LINK.findall(re.sub(r"`[^`\n]*`", "", document.read_text(encoding="utf-8"))):
        if re.match(r"[a-z]+:", link):
            continue
        name, _, anchor = link.partition("#")
        target = document.parent / name if name else document
        if not target.exists():
            yield f"{document.relative_to(ROOT)}: there is no {name}"
        elif anchor and anchor not in anchors(target.read_text(encoding="utf-8")):
            yield f"{document.relative_to(ROOT)}: {target.name} has no heading for #{anchor}"


def test_links_lead_somewhere():
    listed = subprocess.run(["git", "ls-files", "--cached", "--others", "--exclude-standard", "*.md"], cwd=ROOT, text=True,
                            capture_output=True, check=True).stdout.split()
    documents = [ROOT / name for name in listed if (ROOT / name).exists()]
    assert len(documents) > 50
    assert not [one for document in documents for one in broken(document)]
