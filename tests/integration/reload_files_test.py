"""A server with --reload-files shows everybody what another program has written into a file (FI8)."""

import time

from conftest import connect, run, wait
from pxr import Sdf


def write(path, radius):
    path.write_text(f'#usda 1.0\n\ndef Sphere "Ball"\n{{\n    double radius = {radius}\n}}\n')


def radius(stage):
    return stage.GetAttributeAtPath("/Ball.radius").Get()


def test_a_changed_file_reaches_all_editors(project, serve):
    write(project / "ball.usda", 1)
    write(project / "other.usda", 1)
    server = serve(project, "--reload-files")
    with connect(server, "ada") as ada, connect(server, "bo") as bo:
        stages = {live: live.open_stage("ball.usda") for live in (ada, bo)}
        for live in (ada, bo):
            live.open_layer("other.usda")
        for number in (2, 3):
            write(project / "ball.usda", number)
            wait(lambda n=number: all(radius(stage) == n for stage in stages.values()), ada, bo, timeout=20)
        commit = next(ada.log())
        assert (commit.user, commit.label) == ("", "Reload of ball.usda")
        # Editing goes on, and what is not saved stays.
        stages[ada].GetAttributeAtPath("/Ball.radius").Set(7.0)
        assert ada.flush()
        write(project / "ball.usda", 4)
        write(project / "other.usda", 5)
        other = Sdf.Find(ada.open_layer("other.usda").identifier)
        wait(lambda: other.GetAttributeAtPath("/Ball.radius").default == 5, ada, bo, timeout=20)
        wait(lambda: ada.layer_states()["ball.usda"].outdated, ada, bo, timeout=20)
        assert radius(stages[bo]) == 7
        assert run("reload", server.url, "ball.usda")
        wait(lambda: all(radius(stage) == 4 for stage in stages.values()), ada, bo, timeout=20)
        # The next change is taken again.
        write(project / "ball.usda", 8)
        wait(lambda: all(radius(stage) == 8 for stage in stages.values()), ada, bo, timeout=20)


def test_a_file_that_is_written_slowly_is_read_when_it_is_whole(project, serve):
    write(project / "ball.usda", 1)
    server = serve(project, "--reload-files")
    with connect(server, "ada") as ada:
        stage = ada.open_stage("ball.usda")
        text = (project / "ball.usda").read_text().replace("radius = 1", "radius = 2")
        with (project / "ball.usda").open("w") as file:
            for part in (text[:20], text[20:45], text[45:]):
                file.write(part)
                file.flush()
                end = time.monotonic() + 1.2
                while time.monotonic() < end:
                    ada.tick()
                    time.sleep(0.02)
        wait(lambda: radius(stage) == 2, ada, timeout=20)


def test_without_the_option_nothing_is_reloaded(project, serve):
    write(project / "ball.usda", 1)
    server = serve(project)
    with connect(server, "ada") as ada:
        stage = ada.open_stage("ball.usda")
        write(project / "ball.usda", 2)
        wait(lambda: ada.layer_states()["ball.usda"].outdated, ada, timeout=20)
        assert radius(stage) == 1
