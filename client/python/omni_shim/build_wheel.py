"""Builds the wheel: the files of src/ at its root. A build backend (PEP 517) without dependencies."""

from __future__ import annotations

import base64
import hashlib
import pathlib
import tomllib
import zipfile

_HERE = pathlib.Path(__file__).parent
_PROJECT = tomllib.loads((_HERE / "pyproject.toml").read_text())["project"]
_NAME = f"{_PROJECT['name'].replace('-', '_')}-{_PROJECT['version']}"


def _metadata() -> str:
    fields = {"Metadata-Version": "2.1", "Name": _PROJECT["name"], "Version": _PROJECT["version"],
              "Summary": _PROJECT["description"], "Requires-Python": _PROJECT["requires-python"],
              "Description-Content-Type": "text/markdown"}
    lines = [f"{key}: {value}" for key, value in fields.items()]
    lines += [f"Requires-Dist: {name}" for name in _PROJECT["dependencies"]]
    return "\n".join([*lines, "", (_HERE / _PROJECT["readme"]).read_text()])


def build_wheel(wheel_directory: str, config_settings: object = None,
                metadata_directory: object = None) -> str:
    files = {path.name: path.read_bytes() for path in sorted((_HERE / "src").glob("usdlive_omni.*"))}
    files[f"{_NAME}.dist-info/METADATA"] = _metadata().encode()
    files[f"{_NAME}.dist-info/WHEEL"] = (
        b"Wheel-Version: 1.0\nGenerator: usdlive\nRoot-Is-Purelib: true\nTag: py3-none-any\n")
    record = f"{_NAME}.dist-info/RECORD"
    lines = [f"{name},sha256={_digest(content)},{len(content)}" for name, content in files.items()]
    files[record] = "\n".join([*lines, f"{record},,", ""]).encode()
    wheel = f"{_NAME}-py3-none-any.whl"
    with zipfile.ZipFile(pathlib.Path(wheel_directory) / wheel, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return wheel


def _digest(content: bytes) -> str:
    return base64.urlsafe_b64encode(hashlib.sha256(content).digest()).rstrip(b"=").decode()
