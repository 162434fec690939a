"""The documentation site: built without a warning, links that lead somewhere, a search and pages that work offline."""

import functools
import subprocess
import sys
import threading
from html.parser import HTMLParser
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from urllib.parse import unquote, urlsplit

import pytest

from tests.helpers import chromium

pytestmark = pytest.mark.slow
PAGES = ("docs/start", "docs/concepts", "docs/benchmarks", "docs/api/jaxik", "notebooks/1_the_paper")


@pytest.fixture(scope="module")
def site(repository, tmp_path_factory):
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", "-b", "html", "-c", "docs/site", "-d"]
    run = subprocess.run(
        [*command, folder / "trees", ".", folder / "html"], cwd=repository, capture_output=True, text=True,
        timeout=300, check=False,
    )  # fmt: skip
    assert run.returncode == 0, run.stdout + run.stderr
    return folder / "html"


class Links(HTMLParser):
    """Addresses and anchors of a page."""

    def __init__(self):
        super().__init__()
        self.anchors, self.addresses, self.loaded = set(), [], []

    def handle_starttag(self, tag, attributes):
        named = dict(attributes)
        self.anchors |= {named[key] for key in ("id", "name") if named.get(key)}
        address = named.get("href") or named.get("src")
        if address:
            self.addresses.append(address)
        if address and (tag in ("img", "script", "iframe") or named.get("rel") == "stylesheet"):
            self.loaded.append(address)


def test_links_lead_somewhere_and_nothing_is_loaded_from_elsewhere(site):
    pages = {}
    for file in site.rglob("*.html"):
        pages[file] = Links()
        pages[file].feed(file.read_text(encoding="utf-8"))
    assert len(pages) > 40
    broken = []
    for file, page in pages.items():
        broken += [f"{file.name} loads {a}" for a in page.loaded if urlsplit(a).netloc]
        for address in page.addresses:
            parts = urlsplit(address)
            if parts.scheme or parts.netloc:
                continue
            target = (file.parent / unquote(parts.path)).resolve() if parts.path else file
            anchor = unquote(parts.fragment)
            if not target.exists() or (anchor and target in pages and anchor not in pages[target].anchors):
                broken.append(f"{file.relative_to(site)}: {address}")
    assert not broken, "\n".join(broken)


def test_every_page_of_the_documentation_is_there(site, repository):
    made = {file.relative_to(site).with_suffix("").as_posix() for file in site.rglob("*.html")}
    texts = [*repository.glob("docs/**/*.md"), *repository.glob("notebooks/*.ipynb")]
    assert {file.relative_to(repository).with_suffix("").as_posix() for file in texts} <= made


@pytest.fixture
def server(site):
    handler = functools.partial(SimpleHTTPRequestHandler, directory=str(site))
    handler.log_message = lambda *_: None
    with ThreadingHTTPServer(("localhost", 0), handler) as running:
        thread = threading.Thread(target=running.serve_forever, daemon=True)
        thread.start()
        yield f"http://localhost:{running.server_port}"
        running.shutdown()
        thread.join()


def test_a_browser_searches_shows_pictures_and_fits_a_phone(server):
    chromium.require()
    with chromium.visit(server) as visit:
        page = visit.page
        page.wait_for_url("**/docs/index.html")
        page.goto(f"{server}/search.html?q=solve_ik")
        page.wait_for_selector("#search-results li a", timeout=30_000)
        found = page.eval_on_selector_all("#search-results li a", "links => links.map(a => a.href)")
        assert any("docs/api/jaxik.html" in address for address in found)
        page.set_viewport_size({"width": 375, "height": 700})
        for name in PAGES:
            page.goto(f"{server}/{name}.html")
            page.evaluate("for (const i of document.images) i.loading = 'eager'")
            page.wait_for_function("[...document.images].every(i => i.complete)")
            assert page.evaluate("[...document.images].filter(i => !i.naturalWidth).map(i => i.src)") == []
            assert page.evaluate("document.documentElement.scrollWidth") <= 375, name
        assert visit.errors == []
        assert visit.strangers == []
