"""The viewer's page in a real browser: every kind of item opened, played, scrubbed, acted out, pushed, compared."""

import time

import numpy as np
import pytest

import chromium

for name in ("viser", "mjviser", "websockets"):
    pytest.importorskip(name, reason=f"{name} is not installed: pip install 'mimicbench[view]'")
if chromium.found() is None:
    pytest.skip("there is no Chromium here: apt install chromium", allow_module_level=True)

from making import make, small  # noqa: E402
from mimicbench.viewer.page import Page, ViewConfig  # noqa: E402

SLOW = 240.0
"""[s] Pictures are drawn by the processor, which may be busy."""


def eventually(condition):
    """The server does what the page asks for a moment later."""
    end = time.monotonic() + SLOW
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.1)


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    """A page on a small workdir."""
    folder = tmp_path_factory.mktemp("work")
    make("retarget", folder, small(clips=2))
    found = Page(ViewConfig(folder, 18190))
    found.server.scene.configure_default_lights(cast_shadow=False)
    yield found
    found.close()


@pytest.fixture(scope="module")
def browser(page):
    """A browser that shows it."""
    with chromium.Browser() as found:
        found.go(page.url)
        found.wait_for("1 of 2", SLOW)
        yield found


def test_all_kinds_open(browser, page):
    first = page.session.opened
    browser.choose("Kind", "objects")
    browser.wait_for("nobody moves", SLOW)
    eventually(lambda: page.session.opened.obj.id == page.session.opened.name)
    browser.choose("Kind", "human references")
    browser.wait_for("human · ", SLOW)
    eventually(lambda: list(page.session.actors) == ["human", "retargeted"])
    browser.choose("Kind", "retargeted clips")
    eventually(lambda: page.browse.current.kind == "retarget" and page.session.opened.name == first.name)
    browser.wait_for("retargeted: kept", SLOW)


def test_items_are_found_and_stepped_through(browser, page):
    first = page.session.opened.name
    browser.click("Next")
    browser.wait_for("2 of 2", SLOW)
    eventually(lambda: page.session.opened.name != first)
    browser.type("Find", "no such clip")
    browser.wait_for("has 'no such clip' in its name", SLOW)
    browser.type("Find", first[-5:])
    browser.wait_for("1 of 1", SLOW)
    eventually(lambda: page.session.opened.name == first)
    browser.type("Find", "")
    browser.wait_for("1 of 2", SLOW)


def test_the_timeline_plays_and_steps(browser, page):
    browser.click(">|")
    browser.wait_for("K fulfilled", SLOW)
    eventually(lambda: page.session.time == pytest.approx(page.session.duration))
    browser.click("|<")
    browser.wait_for("K lacks: pelvis", SLOW)
    browser.click(">")
    page_time = 1 / page.session.opened.clip.fps
    browser.wait(f"[...document.querySelectorAll('input')].some(one => Math.abs(one.value - {page_time}) < 0.02)", SLOW)
    eventually(lambda: page.session.time == pytest.approx(page_time))
    browser.click("Play")
    browser.wait_for("Pause", SLOW)
    browser.click("Pause")
    browser.wait_for("Play", SLOW)
    assert page.session.time >= page_time


def test_two_methods_act_side_by_side_and_are_pushed(browser, page):
    browser.choose("Method", "tracker")
    browser.choose("Compare with", "bc")
    alone = page.server.initial_camera
    middle, distance = alone.look_at[1], np.linalg.norm(np.subtract(alone.position, alone.look_at))
    eventually(lambda: [box.value for box in page.act.who.values()] == ["tracker", "bc"])
    browser.click("Act")
    browser.wait_for("largest e so far", SLOW)
    eventually(lambda: set(page.act.episodes) == {"robot", "other"})
    eventually(lambda: page.session.hidden == {"human"})  # the clip stays for who follows it
    both = page.server.initial_camera
    assert both.look_at[1] < middle - 0.5, "between the two"
    assert np.linalg.norm(np.subtract(both.position, both.look_at)) > distance + 0.3, "farther away"
    browser.click("Forward")
    browser.wait_for("bc · ", SLOW)
    browser.click("Pause")
    eventually(lambda: not page.play.playing and len(page.act.episodes["robot"].track) > 1)
    browser.click("Elevation map")
    browser.wait_for("Elevation map, ahead is up", SLOW)
    browser.click("Depth cameras")
    browser.wait_for("Depth: ", SLOW)
    browser.click("Color cameras")
    browser.wait("/Color: |no OpenGL/.test(document.body.innerText)", SLOW)
    browser.click("Contact forces")
    browser.wait_for("Curves", SLOW)


def test_a_policy_has_the_scene_for_itself(browser, page):
    browser.choose("Method", "bc")
    browser.choose("Compare with", "nobody")
    browser.click("Act")
    eventually(lambda: page.session.hidden == {"human", "retargeted"})
    browser.wait_checked("Human", False, SLOW)
    browser.click("Human")
    eventually(lambda: page.session.hidden == {"retargeted"})
    browser.wait_for("Pause", SLOW)
    browser.click("Pause")
    browser.click("Next")
    eventually(lambda: not page.session.hidden)
    browser.click("Previous")
    browser.wait_for("1 of 2", SLOW)


def test_what_cannot_be_is_told_and_the_page_goes_on(browser, page):
    browser.choose("Method", "nobody")
    browser.choose("Compare with", "nobody")
    eventually(lambda: [box.value for box in page.act.who.values()] == ["nobody", "nobody"])
    browser.click("Act")
    browser.wait_for("choose a method first", SLOW)
    browser.click("|<")
    browser.wait_for("K lacks", SLOW)


def test_the_console_is_free_of_errors(browser):
    browser.run("1")
    assert not [words for level, words in browser.console if level == "error"]
    elsewhere = [url for url in browser.requests if not url.startswith(("http://localhost", "data:", "blob:"))]
    assert not elsewhere, "the page needs nothing from the network"
