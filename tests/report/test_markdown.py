"""The comment for a pull request, as a reader of GitHub's Markdown renders it: markdown-it."""

import re
from typing import Any

import pytest
from markdown_it import MarkdownIt

from gcs_bridge.report.baseline import known_from
from gcs_bridge.report.formats import FORMATS, Asked, Refused
from tests.helpers.report_entries import ALARM, entry, report, vehicle, without_quaternion

ALARMED = entry(vehicle("alarm"), verdict="alarm", path="bad_one.tlog")


def comment(*files: dict[str, Any], **asked: Any) -> str:
    return FORMATS["markdown"](report(*files), Asked(**asked))


def rendered(*files: dict[str, Any], **asked: Any) -> str:
    return str(MarkdownIt("gfm-like", {"html": True}).render(comment(*files, **asked)))


def cells(html: str) -> list[list[str]]:
    rows = re.findall(r"<tr>(.*?)</tr>", html, re.DOTALL)
    return [re.findall(r"<td>(.*?)</td>", row, re.DOTALL) for row in rows[1:]]


def test_the_verdict_comes_first_and_each_vehicle_has_a_row() -> None:
    """Words beside the signs, and the command that brings what is missing."""
    html = rendered(ALARMED, entry(without_quaternion(sysid=7), verdict="no_compare", path="half.tlog"))
    assert "<h3>❌ Attitude: ALARM</h3>" in html
    bad, half = cells(html)
    assert bad == ["bad_one.tlog", "1,1 ardupilot quadrotor", "❌ ALARM", "99.8 %", "1 raised: euler_quaternion"]
    assert half[1:4] == ["7,1 ardupilot quadrotor", "❔ NO COMPARE", "no"]
    assert "MESSAGE" in half[4].upper()


def test_an_alarm_is_told_whole_behind_a_fold() -> None:
    """And so is that it was so before."""
    html = rendered(ALARMED)
    assert "<summary>❌ ALARM bad_one.tlog, vehicle 1,1: euler_quaternion at 12.4 s</summary>" in html
    assert "from 12.4 s to 15.0 s of boot 0" in html
    files = report(ALARMED).files
    known = rendered(ALARMED, known=known_from(files, files))
    assert cells(known)[0][4] == "1 as in the baseline: euler_quaternion"


def test_text_from_outside_neither_marks_up_nor_mentions() -> None:
    """A file's name with everything in it that means something somewhere."""
    hostile = "a|b *c* <img src=x> [d](http://e) @f `g` www.tlog #12 gh-3"
    alarm = {**ALARM, "what": hostile}
    of = entry(vehicle("alarm", alarms=[alarm]), verdict="alarm", path=hostile)
    html = rendered(of)
    assert not re.search(r"<(img|em|a|code)\b", html)
    assert not re.search(r"@f|#12|gh-3", html)
    assert "www." not in comment(of)  # GitHub makes a link of it before anything else
    assert len(cells(html)) == 1
    assert cells(html)[0][0].startswith("a|b *c* &lt;img src=x&gt; [d](http://e)")


@pytest.mark.parametrize("count", [10, 1000])
def test_it_is_never_longer_than_a_comment_may_be(count: int) -> None:
    """GitHub takes 65,536 characters; what is left out is said."""
    told = comment(*[entry(vehicle("alarm"), verdict="alarm", path=f"{i}.tlog") for i in range(count)])
    assert len(told) <= 65_536
    assert ("are left out" in told) == (count == 1000)
    assert MarkdownIt("gfm-like").render(told).count("<table>") == 1


def test_sources_that_cannot_be_used_are_told() -> None:
    """Even if there is nothing else."""
    assert "<li>❌ gone.tlog: cannot be read</li>" in rendered(
        refused=[Refused("gone.tlog", "gone.tlog: cannot be read")]
    )
