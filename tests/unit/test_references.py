"""References and repeats in a campaign file: what is refused, and what a file without fault gives."""

import pytest

from ema import CampaignError, read_campaign


@pytest.fixture
def campaign(tmp_path, campaign_text):
    """Read a campaign of configurations with these keys, all of one file."""
    (tmp_path / "points.csv").write_text("node,x,y,z\n1,0,0,0\n")
    (tmp_path / "frf.csv").write_text("1,0,0\n")
    head = campaign_text.rpartition("[[configuration]]")[0]

    def read(**configurations):
        text = head + "".join(
            f'[[configuration]]\nname = "{name}"\nfiles = "frf.csv"\noutput = "1+z"\ninput = "1+z"\n{keys}\n'
            for name, keys in configurations.items()
        )
        (tmp_path / "campaign.toml").write_text(text)
        return read_campaign(tmp_path / "campaign.toml")

    return read


def test_a_reference_may_be_a_name_or_a_list(campaign):
    found = campaign(A="", B='repeat_of = "A"', C='compare_to = "A"', D='compare_to = ["A", "C"]')
    assert [own.compare_to for own in found.configurations] == [(), (), ("A",), ("A", "C")]
    assert found.configuration("B").repeat_of == "A"
    assert found.reassembly.frequency == 0.003


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({"A1": "", "B": 'compare_to = "A2"'}, "configuration 'B': compare_to: no 'A2'; .*A1"),
        ({"A": 'compare_to = "A"'}, "'A': compare_to: names itself"),
        ({"A": 'repeat_of = "A"'}, "'A': repeat_of: names itself"),
        ({"A": "", "B": 'compare_to = ["A", "A"]'}, "'B': compare_to: names one state twice"),
        ({"A": 'compare_to = "B"', "B": 'compare_to = "A"'}, "goes round: A -> B -> A"),
        ({"A": 'compare_to = "C"', "B": 'compare_to = "A"', "C": 'compare_to = "B"'}, "goes round: A -> C -> B -> A"),
        ({"A": 'compare_to = "B"', "B": 'repeat_of = "A"'}, "'B' is a repeat of it"),
        ({"A": "", "B": 'repeat_of = "A"', "C": 'repeat_of = "B"'}, "'B' is a repeat itself; .*'A'"),
        ({"A": "", "B": "", "C": 'repeat_of = "B"\ncompare_to = "A"'}, "move compare_to to 'B'"),
    ],
)  # fmt: skip
def test_what_makes_no_sense_is_refused_by_its_name(campaign, keys, said):
    with pytest.raises(CampaignError, match=said) as caught:
        campaign(**keys)
    assert "campaign.toml" in str(caught.value)
