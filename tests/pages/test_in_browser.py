"""A page in a real browser: no errors, a table that sorts and filters, and a click that centers a handle."""

from __future__ import annotations

import io
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from browser import opened_browser, page_in
from PIL import Image

import topokit as tk
from topokit.export.picture import MARK_COLORS
from topokit.pages import Entry, page_of, write_html
from topokit.testing import genus_mesh, icosphere, sphere_samples, torus_mesh

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

HOSTILE = "<script>alert(1)</script><img src=x onerror=alert(2)>.obj"
OFFSET = np.array([500.0, -20.0, 3.0])
VERTICES, FACES = torus_mesh()
TORUS = tk.from_mesh(VERTICES + OFFSET, FACES)
TORN = tk.from_mesh(VERTICES + OFFSET, FACES[1:])


@pytest.fixture(scope="module")
def page_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("page") / "shapes.html"
    shapes = (
        tk.from_mesh(icosphere(2)),
        tk.from_mesh(genus_mesh(12, resolution=12)),
        tk.from_points(sphere_samples(800).points),
    )
    entries = [Entry("torus", page_of(TORUS, TORUS.report(locate=True)), seconds=2.0)]
    entries += [Entry(f"{i}.obj", page_of(shape, shape.report()), seconds=10.0 * i) for i, shape in enumerate(shapes)]
    entries.append(Entry(HOSTILE, None, error=f"{HOSTILE} is empty"))
    write_html(entries, path)
    return path


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    """One for all tests here, and no longer: while it runs, no other event loop can in this thread."""
    with opened_browser() as browser:
        yield browser


@pytest.fixture
def page(browser: Browser, page_file: Path) -> Iterator[Page]:
    with page_in(browser) as (page, complaints):
        page.goto(page_file.as_uri())
        yield page
        assert complaints == []


def names(page: Page) -> list[str]:
    return page.locator("#shapes tbody tr:visible .name").all_text_contents()


def target(page: Page) -> np.ndarray:
    return np.array(page.locator("#canvas").get_attribute("data-target").split(","), dtype=float)


def test_the_table_sorts_and_filters(page: Page) -> None:
    as_written = [HOSTILE, "torus", "0.obj", "1.obj", "2.obj"]
    assert names(page) == as_written
    page.click("th[data-key=euler]")
    assert names(page) == ["1.obj", "torus", "0.obj", "2.obj", HOSTILE], "numbers by size, nothing last"
    page.click("th[data-key=euler]")
    assert names(page) == ["0.obj", "2.obj", "torus", "1.obj", HOSTILE]
    page.fill("#filter", "genus>0 χ<=0")
    assert names(page) == ["torus", "1.obj"]
    assert page.text_content("#shown") == "2 of 5 shown"
    page.fill("#filter", "no such words")
    assert names(page) == []
    page.fill("#filter", "")
    page.click("#verdicts .certain")
    assert names(page) == ["2.obj", HOSTILE]


def middle(points: np.ndarray) -> np.ndarray:
    return (points.min(axis=0) + points.max(axis=0)) / 2


def assert_flies_to(page: Page, number: int, place: np.ndarray) -> None:
    """The mark is chosen, and the camera looks at it when it has come to rest, however slow the machine is."""
    page.wait_for_selector(f"#canvas[data-chosen='{number}']")
    for _ in range(100):
        if np.allclose(target(page), place, atol=2e-3):
            return
        page.wait_for_timeout(200)
    np.testing.assert_allclose(target(page), place, atol=2e-3)


def test_a_click_centers_a_handle(page: Page) -> None:
    page.click("text=torus")
    page.wait_for_selector("#canvas[data-target]")
    np.testing.assert_allclose(target(page), OFFSET, atol=2e-3)
    [handle] = TORUS.handles()
    for number, loop in enumerate((handle.handle_loop, handle.tunnel_loop)):
        page.click(f"text={('handle', 'tunnel')[number]} loop")
        assert_flies_to(page, number, middle(loop))
    assert np.abs(middle(handle.handle_loop) - OFFSET).max() > 0.5, "the handle loop is on one side of the torus"
    page.click("text=Whole")
    np.testing.assert_allclose(target(page), OFFSET, atol=2e-3)


def test_a_click_centers_a_boundary(browser: Browser, tmp_path: Path) -> None:
    TORN.save_html(tmp_path / "torn.html")
    [boundary] = TORN.boundaries()
    with page_in(browser) as (page, complaints):
        page.goto((tmp_path / "torn.html").as_uri())
        page.click("text=boundary 1")
        assert_flies_to(page, 0, middle(boundary.points))
        assert complaints == []


def test_a_click_before_the_shape_is_unpacked_is_not_lost(page: Page) -> None:
    page.evaluate(
        """() => {
            history.replaceState(null, "", "#shape-1");
            dispatchEvent(new HashChangeEvent("hashchange"));
            document.querySelector("#details tr[data-mark='0']").click();
        }"""
    )
    [handle] = TORUS.handles()
    assert_flies_to(page, 0, middle(handle.handle_loop))


def test_the_view_shows_the_surface_and_its_lines(page: Page) -> None:
    page.click("text=torus")
    page.wait_for_selector("#canvas[data-target]")
    page.evaluate("() => new Promise((drawn) => requestAnimationFrame(() => requestAnimationFrame(drawn)))")
    view = np.asarray(Image.open(io.BytesIO(page.locator("#view").screenshot())).convert("RGB")).astype(int)
    red, green, blue = np.moveaxis(view, 2, 0)
    assert ((red - blue > 40) & (np.abs(green - blue) < 60)).mean() > 0.03, "the outside of the torus"
    assert ((blue - red > 40) & (blue - green > 10)).mean() > 0.01, "its inside"
    near = np.abs(view - np.array(MARK_COLORS["handle"])).sum(axis=2) < 60
    assert near.sum() > 100, "the handle loop"


def test_steps_and_addresses_lead_from_shape_to_shape(page: Page, page_file: Path) -> None:
    page.goto(f"{page_file.as_uri()}#shape-1")
    assert page.text_content("#heading") == "torus"
    page.click("#previous")
    page.locator("#heading", has_text="script").wait_for()  # wait_for_function would need eval, which is forbidden
    assert page.text_content("#heading") == HOSTILE
    assert f"{HOSTILE} is empty" in str(page.text_content("#details"))
    assert page.locator("#message").is_visible()
    page.click("#next")
    page.locator("#heading", has_text="torus").wait_for()
    page.keyboard.press("Escape")
    page.wait_for_selector("#list", state="visible")
    page.click("text=1.obj")
    page.wait_for_selector("#canvas[data-target]")


def test_a_single_shape_is_shown_at_once(browser: Browser, tmp_path: Path) -> None:
    tk.from_points(sphere_samples(800).points).save_html(tmp_path / "one.html")
    with page_in(browser, 700, 500) as (page, complaints):
        page.goto((tmp_path / "one.html").as_uri())
        page.wait_for_selector("#canvas[data-target]")
        assert page.locator("#list").is_hidden()
        assert page.locator("#back").is_hidden()
        assert "likely" in str(page.text_content("#details"))
        assert complaints == []
