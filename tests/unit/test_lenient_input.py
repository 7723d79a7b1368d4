"""What other editors and programs write, and people mean, is read as it is meant."""

import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from ema.campaign.campaign import read_campaign
from ema.campaign.measurement import read_measurement
from ema.io.measured_function import parse_unit
from ema.io.table import read_points
from ema.plot.figures import as_png, shape_figure
from ema.types.frf import Geometry
from model import read_stack
from model.stack.stack_file import stack_inputs
from updating.commands.update import read_update_file

MARK = b"\xef\xbb\xbf"
POINTS = "node,x,y,z\n1,-150,0,5\n2,150,0,5\n"
RUN = "".join(f"{f},1,0.5\n" for f in range(1, 40))


@pytest.fixture
def campaign(tmp_path, campaign_text):
    """Write a campaign of one function at each of two points, with further keys, and return its file."""

    def write(keys='files = ["run_*.csv"]\noutput = ["1+z", "2+z"]\ninput = ["1+z"]\n', points=""):
        files = {"points.csv": POINTS, "run_1.csv": RUN, "run_2.csv": RUN}
        files["campaign.toml"] = campaign_text.replace('unit = "mm"\n', f'unit = "mm"\n{points}') + keys
        for name, text in files.items():
            (tmp_path / name).write_text(text, encoding="utf-8")
        return tmp_path / "campaign.toml"

    return write


def marked(file: Path) -> Path:
    file.write_bytes(MARK + file.read_bytes())
    return file


def test_a_mark_of_the_byte_order_is_no_part_of_a_file(campaign, tmp_path, stack_text):
    file = marked(campaign())
    for name in ("points.csv", "run_1.csv"):
        marked(tmp_path / name)
    found = read_campaign(file)
    assert found.name == "small"
    assert read_measurement(found, "M1").frf.frequency[0] == 1.0
    stack = tmp_path / "stack.toml"
    stack.write_text(stack_text, encoding="utf-8")
    assert read_stack(marked(stack)).n_lamina == 240
    assert stack_inputs(stack) == (stack,)
    update = tmp_path / "update.toml"
    update.write_text('name = "one"\n[[campaign]]\nfile = "campaign.toml"\n', encoding="utf-8")
    assert read_update_file(marked(update)).name == "one"


@pytest.mark.parametrize("delimiter", [";", "\t"])
def test_decimal_commas_where_no_comma_separates(tmp_path, delimiter):
    rows = ["node x y z", "1 -150,5 0 5,25", "2 150,5 0 5,25"]
    (tmp_path / "points.csv").write_text("\n".join(rows).replace(" ", delimiter), encoding="utf-8")
    found = read_points(tmp_path / "points.csv", parse_unit("mm"))
    np.testing.assert_allclose(found.coordinate[0], [-0.1505, 0.0, 0.00525])


def test_cells_without_a_name_are_ignored_where_they_are_empty(tmp_path):
    (tmp_path / "points.csv").write_text("node,x,y,z\n1,0,0,5,,\n", encoding="utf-8")
    assert read_points(tmp_path / "points.csv", parse_unit("mm")).node.tolist() == [1]


def test_one_is_written_without_brackets(campaign):
    keys = 'files = "run_1.csv"\noutput = "1+z"\ninput = {node = 2, direction = [0, 0, -2]}\n'
    (files,) = read_campaign(campaign(keys)).configurations[0].files
    assert [file.name for file in files.files] == ["run_1.csv"]
    assert files.output == ((1, (0.0, 0.0, 1.0)),)
    assert files.input == ((2, (0.0, 0.0, -1.0)),)


def test_trace_lines_by_the_ten_thousand(campaign):
    """Each is drawn once, however often it is given, and all by one stroke."""
    found = read_campaign(campaign(points=f"lines = [[{'1, 2, ' * 50_000}]]\n"))
    assert found.geometry.line.tolist() == [[1, 2], [2, 1]]
    rng = np.random.default_rng(0)
    geometry = Geometry(
        node=np.arange(300), coordinate=rng.normal(size=(300, 3)), line=rng.integers(300, size=(20_000, 2))
    )
    modes = SimpleNamespace(
        geometry=geometry, node=geometry.node, direction=np.tile([0.0, 0.0, 1.0], (300, 1)),
        shape=rng.normal(size=(300, 1)) + 0j, frequency=np.array([50.0]), damping=np.array([0.01]),
    )  # fmt: skip
    start = time.process_time()
    as_png(shape_figure(modes, 0))
    assert time.process_time() - start < 4.0
