"""Figures that are described once, as they are printed."""

import numpy as np
import pytest

from ema.plot import palette
from updating.report.change_part import Step, step_chart
from updating.report.modes_part import mac_chart
from updating.report.part import Chart, axis, printed

SIZE = (6.0, 4.0)


def drawn(*traces, **layout):
    return printed(Chart(traces=traces, layout=layout), SIZE)


def test_a_matrix_prints_every_value_and_whose_its_rows_are():
    values = np.array([[1.0, 0.25], [0.0, 0.97], [0.5, 0.125]])
    chart = mac_chart(values, np.array([100.0, 200.0, 300.0]), np.array([101.0, 202.0]), "model", "measured")
    axes, scale = printed(chart, SIZE).axes
    assert [t.get_text() for t in axes.texts] == [f"{v:.2f}" for v in values.ravel()]
    assert [t.get_text() for t in axes.get_yticklabels()] == ["1: 100.0", "2: 200.0", "3: 300.0"]
    assert axes.yaxis_inverted()
    assert scale.get_ylabel() == "MAC"
    assert printed(chart, SIZE).axes[0].collections[0].get_cmap().name == palette.LIKENESS


def test_panels_stand_above_each_other_as_their_parts_of_the_height_say():
    low = {"type": "bar", "x": ["a", "b"], "y": [1.0, 2.0], "yaxis": "y2", "name": "low"}
    high = {"type": "bar", "x": ["b", "a"], "y": [3.0, 4.0], "name": "high"}
    figure = drawn(
        low, high,
        yaxis=axis("above", domain=[0.5, 1.0]), yaxis2=axis("below", domain=[0.0, 0.4]), xaxis=axis("which"),
    )  # fmt: skip
    above, below = figure.axes
    assert (above.get_ylabel(), below.get_ylabel(), below.get_xlabel()) == ("above", "below", "which")
    assert [bar.get_height() for bar in above.patches] == [3.0, 4.0]
    assert [bar.get_x() for bar in above.patches] == pytest.approx([bar.get_x() for bar in below.patches][::-1])
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["high", "low"]


def test_bars_of_one_group_stand_beside_each_other_those_of_others_do_not_hide_them():
    traces = [{"type": "bar", "x": ["a"], "y": [1.0], "name": name} for name in ("first", "second")]
    first, second = drawn(*traces).axes[0].patches
    assert first.get_x() + first.get_width() < second.get_x() + 0.05 * second.get_width()


def test_intervals_go_as_far_down_and_up_as_they_are():
    trace = {
        "type": "scatter", "mode": "markers", "x": [1.0], "y": [10.0],
        "error_y": {"type": "data", "array": [2.0], "arrayminus": [1.0]},
    }  # fmt: skip
    (bars,) = drawn(trace).axes[0].containers
    np.testing.assert_allclose(bars.lines[2][0].get_segments()[0], [[1.0, 9.0], [1.0, 12.0]])


def test_axes_keep_scale_range_and_zero():
    trace = {"type": "scatter", "x": [1.0, 10.0], "y": [2.0, 3.0]}
    axes = drawn(trace, xaxis=axis("G_f [Pa/Pa]", type="log"), yaxis=axis("", rangemode="tozero")).axes[0]
    assert axes.get_xscale() == "log"
    assert axes.get_ylim()[0] == 0.0
    assert axes.get_xlabel() == "$G_f$ [Pa/Pa]"


def test_a_group_stands_in_the_legend_once():
    traces = [
        {"type": "scatter", "x": [k], "y": [k], "legendgroup": "oil", "legendgrouptitle": title, "name": f"S{k}"}
        for k, title in enumerate(({"text": "oil"}, {}))
    ]
    assert [text.get_text() for text in drawn(*traces).legends[0].get_texts()] == ["oil"]


def test_numbers_of_a_chart_stand_under_what_its_axes_show():
    traces = [
        {
            "type": "bar", "name": "fitted", "x": ["base<br>model", "with<br>it"], "y": [3.0, 0.25],
            "error_y": {"array": [0.5, 0.125]},
        }
    ]  # fmt: skip
    layout = {"yaxis": {"title": {"text": "error [%]"}}}
    assert Chart(traces=traces, layout=layout).csv.splitlines() == [
        "series,at,error [%],lower,upper",
        "fitted,base model,3,2.5,3.5",
        "fitted,with it,0.25,0.125,0.375",
    ]


def test_the_last_bar_of_a_waterfall_is_written_as_it_is_drawn():
    way = [Step(name="base", error=0.04, left_out=0.06), Step(name="lost contact", error=0.01, left_out=0.02)]
    rows = [line.split(",") for line in step_chart(way).csv.splitlines()[1:]]
    assert [float(row[2]) for row in rows if row[1] == "what is left"] == [1.0, 2.0]
