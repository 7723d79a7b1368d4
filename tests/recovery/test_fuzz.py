"""The fuzzer sees faults, keeps the input, and reads it first the next time."""

import shutil

import pytest

from ema.types.errors import MeasurementError
from tests.recovery import fuzz
from tests.recovery.damaged_readers import DATA, READERS


@pytest.fixture
def faulty(tmp_path, monkeypatch):
    """One reader alone, with a fault where its file has no comma, and a folder with its file."""
    (tmp_path / "demo_stack").mkdir()
    shutil.copy(DATA / "demo_stack/points.csv", tmp_path / "demo_stack")
    sound, name, errors = READERS["points"]

    def read(file):
        if b"," not in file.read_bytes():
            raise KeyError
        return sound(file)

    monkeypatch.setattr(fuzz, "READERS", {"points": (read, name, errors)})
    monkeypatch.setattr(fuzz, "damaged", lambda data, _: data.replace(b",", b";"))
    return tmp_path


def test_a_fault_is_kept_and_read_first_the_next_time(faulty):
    corpus = faulty / "corpus"
    count, found = fuzz.fuzz(faulty, corpus, 0.05, seed=1)
    ((fault, file),) = found.items()
    assert count > 0
    assert "points: KeyError at test_fuzz.py" in fault
    assert file.parent == corpus / "points"
    count, again = fuzz.fuzz(faulty, corpus, 0.0, seed=1)
    assert (count, again) == (1, found)


def test_what_a_reader_refuses_in_words_is_no_fault(faulty):
    assert fuzz.fault_of("points", faulty, b"a,b") == ""
    _, name, errors = READERS["points"]

    def silent(_):
        raise MeasurementError

    fuzz.READERS["points"] = (silent, name, errors)
    assert fuzz.fault_of("points", faulty, b"a,b") == "MeasurementError without a message"
