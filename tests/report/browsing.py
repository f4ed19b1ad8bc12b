"""Pages in a browser."""

import time


def show(browser, path, width, ready=".live canvas"):
    """Open a page in a window of this width [px] and wait for what its script makes, a CSS selector."""
    metrics = {"width": width, "height": 1000, "deviceScaleFactor": 1, "mobile": False}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
    browser.get(path.as_uri())
    wait(browser, f"return document.querySelectorAll('{ready}').length > 0")


def wait(browser, condition):
    """Fail unless a script returns true within half a minute, which a loaded machine may need."""
    end = time.monotonic() + 30.0
    while not browser.execute_script(condition):
        assert time.monotonic() < end, condition
        time.sleep(0.05)
