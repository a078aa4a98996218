"""Test `dfd` without a specific command: help, errors, exit codes, Ctrl-C."""

import os
import re
import signal
import subprocess
import sys
import time
import warnings
from unittest import mock

import pytest
import typer
from command_runs import failed, worked
from heeding import HEED

from dfd.cli import app as commands


@pytest.mark.parametrize(
    ("error", "message", "code"),
    [
        (ValueError("bind: `features` must be\nfinite"), "dfd: bind: `features` must be finite", 2),
        (OSError(28, "No space left on device"), "dfd: No space left on device", 2),
        (FileNotFoundError(2, "No such file or directory", "a.obj"), "dfd: a.obj: No such file or directory", 2),
        (PermissionError("the cache is locked"), "dfd: the cache is locked", 2),
        (MemoryError(), "dfd: out of memory", 2),
        (MemoryError("distill: lower `views`"), "dfd: out of memory: distill: lower `views`", 2),
        (KeyboardInterrupt(), "dfd: interrupted", 130),
    ],
)
def test_whatever_goes_wrong_is_one_line_and_a_code(run, error, message, code):
    with mock.patch("dfd.load", side_effect=error):
        assert failed(run("inspect", "MESH"), message, code)


def test_a_mistake_of_ours_is_not_hidden(run):
    with mock.patch("dfd.load", side_effect=ZeroDivisionError):
        assert isinstance(run("inspect", "MESH").exception, ZeroDivisionError)


def test_a_warning_is_one_line(run, chair):
    def warns(_):
        with warnings.catch_warnings():
            warnings.simplefilter("always")
            warnings.warn("the texture cannot be read:\nit is shown gray", UserWarning, stacklevel=1)
            warnings.warn("old", DeprecationWarning, stacklevel=1)
        return chair

    with mock.patch("dfd.load", warns):
        result = run("inspect", "MESH")
    assert worked(result)
    assert result.stderr == "dfd: the texture cannot be read: it is shown gray\n"


def test_help_lists_every_command_and_option(run):
    result = run("--help")
    assert worked(result)
    for command in ("demo", "distill", "deform", "show", "inspect"):
        assert command in result.stdout
        assert worked(run(command, "--help"))


def test_help_names_only_options_that_the_command_has():
    for name, command in typer.main.get_command(commands).commands.items():
        own = {option for each in command.params for option in (*each.opts, *each.secondary_opts)}
        texts = [command.help, *(getattr(each, "help", None) for each in command.params)]
        assert set(re.findall(r"(?<!\S)--[a-z][\w-]*", " ".join(filter(None, texts)))) <= own, name


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("inspect", "MESH", "--at", 3), "Option '--at' requires 2 arguments. (see dfd inspect --help)"),
        (("distill", "MESH", "-o", "f", "--views", "many"), "got many (see dfd distill --help)"),
        (("app", "MESH", "--port", 99999), "got 99999 (see dfd app --help)"),
        (("demo", "--preset", "mine"), "'mine' is not one of 'default', 'paper'. (see dfd demo --help)"),
        (("demo", "-o", "MESH"), "`--output` must be a folder, got the file"),
        (("defrom", "MESH"), "(see dfd --help)"),
    ],
)
def test_a_usage_error_names_the_value_and_the_command(run, arguments, message):
    assert failed(run(*arguments), message)


def test_control_characters_of_names_do_not_reach_the_terminal(run, chair):
    named = "\x1b[2J\x9b31m\u202e\udcff"
    assert failed(run("inspect", f"{named}.obj"), r"\x1b[2J\x9b31m\u202e\udcff.obj")
    move = ("--handle", 40, "--translate", 0, 1, 0, "--name", "\x1b[2Jleg", "-o", "\x1b[2J.obj")
    result = run("deform", "MESH", "--field", "FIELD", *move)
    assert worked(result)
    assert "\x1b" not in result.output


def dfd_process(*arguments, module=False, **options):
    how = ["-m", "dfd"] if module else ["-c", HEED]
    return subprocess.Popen(
        [sys.executable, *how, *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        encoding="utf-8",
        env={**os.environ, "PYTHONIOENCODING": "utf-8"},
        **options,
    )


def test_python_m_dfd_is_the_command(tmp_path):
    with dfd_process("--version", module=True) as process:
        output, error = process.communicate(timeout=60)
    assert process.returncode == 0, error
    assert output.startswith("dfd ")
    with dfd_process(
        "show", tmp_path / "none.obj", "-o", tmp_path / "out.png", "--strength", 1, module=True
    ) as process:
        output, error = process.communicate(timeout=60)
    assert process.returncode == 2
    assert output == ""
    assert error == "dfd: `--handle` must be given with `--fix` and the controls of a handle\n"


def test_help_and_version_need_nothing_heavy():
    code = (
        "import sys; from dfd.cli import main\n"
        "try: main(['--help'])\n"
        "except SystemExit: pass\n"
        "print([name for name in ('torch', 'trimesh', 'transformers', 'scipy', 'PIL') if name in sys.modules])"
    )
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60)
    assert result.stdout.splitlines()[-1] == "[]"


def test_control_c_is_one_line_and_code_130(folder, tmp_path):
    # The edit is a pipe to which nothing is written, so that the command waits until it is interrupted.
    pipe = tmp_path / "endless.json"
    os.mkfifo(pipe)
    files = (folder / "chair.obj", "--field", folder / "chair.field.safetensors")
    with dfd_process("deform", *files, "--edit", pipe, "-o", tmp_path / "out.obj") as process:
        try:
            writer = _writer(pipe, process)
            process.send_signal(signal.SIGINT)
            output, error = process.communicate(timeout=60)
            os.close(writer)
        finally:
            process.kill()
    assert process.returncode == 130
    assert error.splitlines()[-1] == "dfd: interrupted"
    assert "Traceback" not in error
    assert output == ""
    assert list(tmp_path.iterdir()) == [pipe]


def _writer(pipe, process, seconds=120):
    """Wait until the process has opened the pipe for reading, and return the end for writing."""
    until = time.monotonic() + seconds
    while True:
        assert process.poll() is None, process.stderr.read()
        assert time.monotonic() < until, "it never opened the pipe"
        try:
            return os.open(pipe, os.O_WRONLY | os.O_NONBLOCK)  # fails until the command has opened the pipe
        except OSError:
            time.sleep(0.05)


@pytest.mark.skipif(not hasattr(signal, "SIGHUP"), reason="needs POSIX signals")
def test_control_c_works_where_it_is_ignored(folder, tmp_path):
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        test_control_c_is_one_line_and_code_130(folder, tmp_path)
    finally:
        signal.signal(signal.SIGINT, before)
