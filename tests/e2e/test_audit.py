"""An extrinsic in use, judged in the page: from the recording to pass and fail on each axis."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from playwright.sync_api import Page, expect

from calib_core.simulate import truth_path
from tests.e2e.support import JOB_WAIT_S, Api, keep_screenshot, serious_faults

#: How many marks turn for ever.
TURNING = "document.getAnimations().filter(one => one.effect.getTiming().iterations === Infinity).length"


def test_an_extrinsic_in_use_is_judged_axis_by_axis(page: Page, api: Api, bag: Path, tmp_path: Path) -> None:
    """Before any solve: the truth, 40 mm off along x and z, fails along x, where 20 mm are allowed, and passes along z, where 60
    mm are.

    Oracle: the simulator's truth. Mutation: limits not sent (z fails too); the direction of bare numbers not sent (all fail);
    a solve asked for first; an audit that the list of recordings does not tell of; marks that turn for ever before a person who
    wants no motion.
    """
    truth = np.array(json.loads(truth_path(bag).read_text())["T_imu_lidar"]["matrix"])
    truth[[0, 2], 3] += 0.040
    file = tmp_path / "in use.txt"
    np.savetxt(file, np.linalg.inv(truth))  # the way that many programs keep it: IMU to lidar

    recording = api.upload(bag)
    api.wait_until_ready(recording)
    page.goto(f"/r/{recording}/recording")
    page.get_by_role("link", name="Audit an extrinsic").click()
    audit = page.get_by_role("button", name="Audit it")
    expect(audit).to_be_disabled()
    page.get_by_label("A file with the extrinsic").set_input_files(file)
    page.get_by_text("IMU to lidar", exact=True).click()
    page.get_by_role("textbox", name="Position, mm").fill("20 20")
    expect(page.get_by_role("alert")).to_contain_text("three for x y z")
    expect(audit).to_be_disabled()
    page.get_by_role("textbox", name="Position, mm").fill("20 20 60")
    audit.click()
    expect(page.get_by_role("progressbar", name="Progress")).to_be_visible()
    expect(page.locator("[data-state=active], [data-state=busy]").first).to_be_visible()
    assert page.evaluate(TURNING) == 0
    expect(page.get_by_role("heading", name="Failed", exact=True)).to_be_visible(timeout=JOB_WAIT_S * 1000)

    table = page.get_by_role("table", name="Given minus found on each axis")
    expect(table.get_by_role("row", name="Position along the IMU’s x")).to_contain_text("fail")
    expect(table.get_by_role("row", name="Position along the IMU’s z")).to_contain_text("pass")
    expect(table.get_by_role("cell", name="pass", exact=True)).to_have_count(5)
    expect(table.get_by_role("row", name="Time offset")).to_contain_text("not given")
    job = page.url.split("job=")[1]
    told = {axis["axis"]: axis for axis in api.ask("GET", f"/api/audits/{job}")["axes"]}
    assert abs(told["tx"]["difference"] - 40.0) < 5.0 * told["tx"]["difference_std"]
    for scheme in ("dark", "light"):
        page.emulate_media(color_scheme=scheme)
        assert serious_faults(page) == []
        keep_screenshot(page, "audit", scheme)
    assert not any(job["kind"] == "solve" for job in api.ask("GET", f"/api/recordings/{recording}/jobs"))
    page.goto("/")
    expect(page.get_by_role("link", name="room.bag").first).to_contain_text("Audit failed")
