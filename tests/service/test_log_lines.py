"""Lines of what runs by itself."""

import datetime

from pipeline.service import processes


def test_a_line_of_a_service_has_its_time(capsys):
    """To the second, in the time of the place, in front of what is said."""
    before = datetime.datetime.now().replace(microsecond=0)
    processes.log("spring: adequate")
    day, clock, said = capsys.readouterr().out.split(" ", 2)

    assert before <= datetime.datetime.fromisoformat(f"{day} {clock}") <= datetime.datetime.now()
    assert said == "spring: adequate\n"
