"""Commands of rigcast, called in this process."""

from pathlib import Path

from typer.testing import CliRunner

from rigcast.cli import app


def call(*arguments: str | Path) -> tuple[int, str]:
    """Exit code and everything printed. What a command raises, and does not report, fails the test."""
    result = CliRunner().invoke(app, [str(argument) for argument in arguments])
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    return result.exit_code, result.output


def call_on_one_line(*arguments: str | Path) -> tuple[int, str]:
    """The same with all white space as single blanks: tables wrap at the width of the terminal."""
    code, output = call(*arguments)
    return code, " ".join(output.split())
