"""Text for messages: lists of words, unique names of files."""

from pathlib import Path

import pytest

from ehsa_ctrl.core.log import Log, named
from ehsa_ctrl.core.text import folder_names, join_words, unique_names


def test_a_list_reads_as_a_sentence():
    """One, two, three."""
    assert [join_words(list("abc")[:n]) for n in range(4)] == ["", "a", "a and b", "a, b and c"]


@pytest.mark.parametrize(
    ("files", "names"),
    [
        (["x/a.csv", "y/b.csv"], ["a.csv", "b.csv"]),
        (["a/log.csv", "b/log.csv"], ["a/log.csv", "b/log.csv"]),
        (["r/1/log.csv", "r/2/log.csv", "r/other.csv"], ["1/log.csv", "2/log.csv", "other.csv"]),
        (["a/x/log.csv", "b/x/log.csv"], ["a/x/log.csv", "b/x/log.csv"]),
        (["log.csv", "log.csv"], ["log.csv", "log.csv"]),
    ],
)
def test_files_of_one_name_are_called_by_their_folders(files, names):
    """With as few folders as necessary."""
    assert unique_names(files) == names


def test_results_of_one_name_get_folders_of_their_own():
    """Without the ending, unless only the ending differs."""
    assert folder_names(["a/log.csv", "b/log.csv", "c.csv"]) == ["a/log", "b/log", "c"]
    assert folder_names(["log.csv", "log.mat"]) == ["log.csv", "log.mat"]


def test_logs_know_what_they_are_called_beside_others():
    """A single log has its file's name; a log in memory has none."""
    logs = [Log([0.0, 1.0], {}, Path(path)) for path in ("a/log.csv", "b/log.csv")]

    assert [log.name for log in named([*logs, Log([0.0, 1.0], {})])] == ["a/log.csv", "b/log.csv", "a log"]
    assert [log.name for log in named(logs[:1])] == ["log.csv"]
