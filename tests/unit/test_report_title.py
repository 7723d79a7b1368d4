"""The head of a report: title block, contents, and what stands at the foot of every printed page."""

import re

from updating.report.page import render
from updating.report.part import Section, in_css


def test_the_title_block_holds_what_the_campaign_states_and_the_contents_every_section():
    parts = (Section(title="Answer"), Section(title="In full"))
    page = render("A", parts, about=(("Project", "P <1>"), ("Author", "M")))
    assert re.findall(r"<dt>(.*?)</dt><dd>(.*?)</dd>", page)[:2] == [("Project", "P &lt;1&gt;"), ("Author", "M")]
    contents = re.search(r'<nav aria-label="Contents">(.*?)</nav>', page, re.DOTALL)[1]
    assert re.findall(r'href="#(.*?)"', contents) == ["answer", "in-full"]


def test_a_title_cannot_end_the_string_of_a_style_sheet_that_holds_it():
    title = 'a "quoted" </style> \\ title'
    assert not set('"<>/\n') & set(in_css(title))
    foot = re.search(r"@bottom-left { content: \"(.*?)\"; }", render(title, ()))[1]
    back = re.sub(r"\\([0-9a-f]+) ", lambda one: chr(int(one[1], 16)), foot)
    assert back == title
