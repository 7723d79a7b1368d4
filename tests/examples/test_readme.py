"""What the README shows runs as it stands there."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def test_the_python_example_runs_and_prints_a_fit(capsys, write_small_campaign, tmp_path):
    """On a small campaign; that of the demo, which it names, is identified and fitted by the test of its story."""
    (code,) = re.findall(r"```python\n(.*?)```", README, flags=re.DOTALL)
    named = "data/demo_diagnosis/campaign.toml"
    assert named in code
    assert (ROOT / named).exists()
    code = code.replace(named, write_small_campaign(tmp_path, 1).as_posix())
    exec(compile(code, "README.md", "exec"), {})
    assert re.search(r"C1: G_f = \d+ ± \d+, frequency error \d+\.\d\d%", capsys.readouterr().out)


def test_every_command_of_the_table_exists():
    from updating.commands.command_line import app

    known = {(c.name or c.callback.__name__) for c in app.registered_commands}
    shown = set(re.findall(r"^\| `lamella ([\w-]+)", README, flags=re.MULTILINE))
    assert shown == known
