"""The command line, called in an empty folder."""

import sys

import pytest

from ehsa_ctrl.cli import main as entry


@pytest.fixture
def run(monkeypatch, capsys, tmp_path):
    """Call the command line in an empty folder; gives exit status, standard output and standard error."""
    monkeypatch.chdir(tmp_path)
    # Whether an engine has to be compiled first depends on the tests before.
    monkeypatch.setattr("ehsa_ctrl.core.compiled.log.info", lambda *arguments: None)

    def call(*arguments):
        monkeypatch.setattr(sys, "argv", ["ehsa-ctrl", *map(str, arguments)])
        with pytest.raises(SystemExit) as stopped:
            entry.main()
        captured = capsys.readouterr()
        return stopped.value.code or 0, captured.out, captured.err

    return call
