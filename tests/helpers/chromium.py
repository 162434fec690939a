"""A headless Chromium driven by playwright, and whether there is one.

Needs Debian's package chromium, no browser of playwright's own. Where it is missing the tests that need it are skipped
and say so; with JAXIK_REQUIRE_CHROMIUM set, as in .ci/run, that is a failure.
"""

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import pytest

# WebGL without a graphics card; no sandbox, which containers run by root do not offer.
ARGUMENTS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
SIZE = {"width": 1000, "height": 700}


def require() -> str:
    """The program's path; skips, or fails where it is required."""
    found = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if found is None:
        say = "viewer tests need Debian's chromium (apt-get install chromium)"
        (pytest.fail if os.environ.get("JAXIK_REQUIRE_CHROMIUM") else pytest.skip)(say)
    return found


@dataclass
class Visit:
    """A page in the browser, and what went on there.

    Attributes:
        page: playwright's page.
        errors: Errors of the console and of scripts.
        strangers: Addresses asked for beyond this machine.
    """

    page: Any
    errors: list[str] = field(default_factory=list)
    strangers: list[str] = field(default_factory=list)


@contextmanager
def visit(address: str) -> Iterator[Visit]:
    """Opens an address, with every other machine cut off."""
    from playwright.sync_api import sync_playwright

    program = require()
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=program, args=ARGUMENTS)
        page = browser.new_page(viewport=SIZE)
        seen = Visit(page)
        page.on("console", lambda m: seen.errors.append(m.text) if m.type == "error" else None)
        page.on("pageerror", lambda error: seen.errors.append(str(error)))

        def judge(route: Any) -> None:
            if route.request.url.startswith((address, "data:", "blob:")):
                route.continue_()
            else:
                seen.strangers.append(route.request.url)
                route.abort()

        page.route("**/*", judge)
        try:
            page.goto(address)
            yield seen
        finally:
            browser.close()
