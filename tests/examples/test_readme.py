"""What the README shows runs as it stands there."""

import re
from pathlib import Path

README = (Path(__file__).parents[2] / "README.md").read_text(encoding="utf-8")


def test_the_python_example_runs_and_prints_a_fit(capsys, monkeypatch):
    monkeypatch.chdir(Path(__file__).parents[2])
    (code,) = re.findall(r"```python\n(.*?)```", README, flags=re.DOTALL)
    assert len(code.strip().splitlines()) <= 10
    exec(compile(code, "README.md", "exec"), {})
    printed = capsys.readouterr().out
    assert re.search(r"M1: G_f = \d+ ± \d+, frequency error [1-9]\.\d\d%", printed)


def test_every_command_of_the_table_exists():
    from updating.commands.command_line import app

    known = {(c.name or c.callback.__name__) for c in app.registered_commands}
    shown = set(re.findall(r"^\| `lamella ([\w-]+)", README, flags=re.MULTILINE))
    assert shown == known
