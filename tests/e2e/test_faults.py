"""What goes wrong is said where it happens, in one sentence, with a way on."""

from __future__ import annotations

from pathlib import Path

import pytest
from playwright.sync_api import Page, expect

from tests.e2e.support import JOB_WAIT_S, keep_screenshot, serious_faults


def test_a_file_that_is_no_bag(page: Page, scheme: str, tmp_path: Path) -> None:
    """The recording's screen says what is wrong with it, and a reload says it again.

    Fails with the recording's error left out of its screen; with the name told under which the server keeps the file.
    """
    wrong = tmp_path / "holiday.bag"
    wrong.write_text("these are not sensor readings\n")
    page.goto("/")
    page.get_by_test_id("file-input").set_input_files(wrong)
    alert = page.get_by_role("alert")
    expect(alert).to_be_visible(timeout=JOB_WAIT_S * 1000)
    told = alert.inner_text()
    assert "Traceback" not in told
    assert "holiday.bag" in told
    assert len(told) > 20
    assert serious_faults(page) == []
    keep_screenshot(page, "fault", scheme)
    page.reload()
    expect(page.get_by_role("alert")).to_have_text(told)


@pytest.mark.parametrize(("path", "words"), [("/nowhere", "nothing at this address")])
def test_an_address_that_leads_nowhere(page: Page, path: str, words: str) -> None:
    """A wrong address says so and leads back. Fails without the route for everything else."""
    page.goto(path)
    expect(page.get_by_role("main")).to_contain_text(words)
    page.get_by_role("link", name="Start page", exact=True).click()
    expect(page.get_by_role("button", name="Try the sample")).to_be_visible()
