"""Links of the pages, as they are: what GitHub shows and the site is built from. No Sphinx is needed."""

import pytest

from tools.site_pages import PAGES, ROOT, anchors, links


@pytest.mark.parametrize("page", PAGES)
def test_links_within_the_project_lead_somewhere(page: str) -> None:
    """Each relative link is a file of the checkout, and what follows a # is a heading of that page."""
    for target, anchor in links(page):
        assert (ROOT / target).is_file(), target
        assert not anchor or anchor in anchors(target), (target, anchor)


def test_a_heading_becomes_the_anchor_that_github_makes() -> None:
    """Signs go, spaces become hyphens, what is code counts as text: by hand, of headings that are there."""
    assert anchors("docs/wrong-attitude.md") >= {
        "a-tailsitter-shows-90",
        "the-model-lies-on-its-side-or-flies-backwards",
    }
    assert anchors("docs/checks.md") >= {"alarm", "euler_quaternion"}
    assert "what-each-mistake-looks-like-gcs-bridge-inject" in anchors("docs/inject.md")


def test_every_page_can_be_reached_from_the_readme() -> None:
    """Whoever begins at the README finds each page by links alone, on GitHub too, where there is no navigation."""
    reached, waiting = set[str](), ["README.md"]
    while waiting:
        page = waiting.pop()
        if page in reached or page not in PAGES:
            continue
        reached.add(page)
        waiting += [target for target, _ in links(page)]
    assert reached == set(PAGES)
