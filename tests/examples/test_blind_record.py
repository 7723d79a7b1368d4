"""The blind figures of the documents are those of the recorded cases."""

from pathlib import Path

from tests.studies import blind, pooled, slipping
from tests.studies.blind_figures import figures, held_out_errors, mean_set_size
from tests.studies.other_models import FIRST_OF_STACKS, RECORD, STACKS_RECORD, OtherCase, median_fall, stack_of
from tests.studies.other_models import figures as figures_elsewhere
from tests.studies.other_models import planned as planned_elsewhere
from tests.studies.runner import recorded

ROOT = Path(__file__).parents[2]


def cases_of_the_table():
    return recorded(blind.RECORD, blind.Case)


def test_the_table_says_what_was_recorded():
    lines = (ROOT / "docs/validation.md").read_text(encoding="utf-8").splitlines()
    cases = cases_of_the_table()
    start = lines.index(f"| figure | {len(cases)} cases | target |") + 2
    found = figures(cases)
    assert lines[start : start + len(found)] == [one.row for one in found]


def test_the_figures_of_the_readme_are_of_the_record():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    table = text.partition("| figure | measured | target | command |\n")[2].partition("\n\n")[0]
    shown = [line.rpartition(" | ")[0] + " |" for line in table.splitlines()[1:]]
    known = {one.name.strip(): one.row for one in figures(cases_of_the_table())}
    known |= {one.name: one.row for one in figures_elsewhere(recorded(RECORD, OtherCase))}
    found = [line for line in shown if line.split(" | ")[0].removeprefix("| ") in known]
    assert len(found) == len(shown) >= 5
    assert set(found) <= set(known.values())  # names that several baselines have tell nothing apart


def test_the_table_of_other_models_says_what_was_recorded():
    text = (ROOT / "docs/validation.md").read_text(encoding="utf-8")
    cases = recorded(RECORD, OtherCase)
    lines = text.splitlines()
    start = lines.index(f"| figure | {len(cases)} cases of another model | target |") + 2
    found = [one.row for one in figures_elsewhere(cases)]
    assert lines[start : start + len(found)] == found
    assert f"(median ratio {median_fall(cases):.2f})" in " ".join(text.split())
    assert sorted((c.seed, c.kind) for c in cases) == planned_elsewhere(len(cases))


def test_the_table_of_three_stacks_says_what_was_recorded():
    lines = (ROOT / "docs/validation.md").read_text(encoding="utf-8").splitlines()
    cases = recorded(STACKS_RECORD, OtherCase)
    start = lines.index(f"| figure | {len(cases)} cases of three stacks | target |") + 2
    found = [one.row for one in figures_elsewhere(cases)]
    assert lines[start : start + len(found)] == found
    assert sorted((c.seed, c.kind) for c in cases) == planned_elsewhere(len(cases), FIRST_OF_STACKS)
    assert all(c.stack == stack_of(c.seed) for c in cases)


def test_the_table_of_slip_says_what_was_recorded():
    lines = (ROOT / "docs/validation.md").read_text(encoding="utf-8").splitlines()
    cases = recorded(slipping.RECORD, slipping.SlippingCase)
    start = lines.index(f"| figure | {len(cases)} cases at three forces | target |") + 2
    found = [one.row for one in slipping.figures(cases)]
    assert lines[start : start + len(found)] == found
    assert [(case.seed, case.slips) for case in cases] == slipping.planned(len(cases))


def test_the_table_of_many_specimens_says_what_was_recorded():
    lines = (ROOT / "docs/validation.md").read_text(encoding="utf-8").splitlines()
    cases = recorded(pooled.RECORD, pooled.PooledCase)
    start = lines.index(f"| figure | {len(cases)} cases of many specimens | target |") + 2
    found = [one.row for one in pooled.figures(cases)]
    assert lines[start : start + len(found)] == found
    assert [(case.seed, case.kind) for case in cases] == pooled.planned(len(cases))


def test_the_sentence_below_the_table_says_what_was_recorded():
    cases = cases_of_the_table()
    base, named, true = held_out_errors(cases)
    said = " ".join((ROOT / "docs/validation.md").read_text(encoding="utf-8").split())
    assert f"the set holds {mean_set_size(cases):.2f} explanations in the mean" in said
    assert (
        f"is matched within {base:.2f} standard deviations (median) by the base model refitted, "
        f"within {named:.2f} with what is named, and within {true:.2f} with the true effect"
    ) in said
    assert f"({cases[0].seed} to {max(case.seed for case in cases)}; each case" in said


def test_the_record_holds_the_planned_cases_from_the_first_on():
    """So a study of a copy of it goes on where it ends."""
    cases = cases_of_the_table()
    assert [(case.seed, case.kind) for case in cases] == list(blind.planned(full=True)[: len(cases)])
