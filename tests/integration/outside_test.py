"""A build from outside the tree: the installed package is found and the example of the README runs."""

import os
import pathlib
import shutil
import subprocess

from conftest import cat

EXAMPLE = pathlib.Path(__file__).parents[2] / "client" / "examples" / "minimal"


def test_find_package_from_outside_the_tree(tmp_path, project, serve):
    (project / "shot.usda").write_text("#usda 1.0\n")
    prefix, source, build = tmp_path / "prefix", tmp_path / "example", tmp_path / "build"
    subprocess.run(["cmake", "--install", os.environ["USDLIVE_BUILD"], "--prefix", prefix], check=True,
                   stdout=subprocess.DEVNULL)
    shutil.copytree(EXAMPLE, source)
    subprocess.run(["cmake", "-G", "Ninja", "-S", source, "-B", build, f"-DCMAKE_PREFIX_PATH={prefix}",
                    "-DCMAKE_BUILD_TYPE=Release",
                    f"-DUSDLIVE_PRODUCT_ENV={os.environ['USDLIVE_PRODUCT_ENV']}",
                    f"-DUSDLIVE_HEADERS_ENV={os.environ['USDLIVE_HEADERS_ENV']}"], check=True,
                   stdout=subprocess.DEVNULL)
    subprocess.run(["cmake", "--build", build], check=True, stdout=subprocess.DEVNULL)
    assert len((source / "main.cpp").read_text().splitlines()) <= 40
    server = serve(project)
    done = subprocess.run([build / "minimal", server.url, "shot.usda", "ada"], capture_output=True,
                          text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    assert '"frame 119"' in cat(server, "shot.usda")
